//! The functions that write an edit, send it and wait.
#![allow(unsafe_code)]

use pairmask::{Margin, Report};
use pairmask_core::scene::{Indices, Sets, Step};

use super::draft::{Draft, Given};
use super::pm_scene;
use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::memory::{array, value};
use crate::rules::table;
use crate::values::{
    boxes as as_boxes, index_count, pairs as as_pairs, pm_box, pm_filter, pm_pair, pm_tag,
    tags as as_tags,
};

/// What indices are: one of `PM_INDICES_...`.
pub type pm_indices_kind = u32;
/// From `first` to before `first + count`.
pub const PM_INDICES_RANGE: pm_indices_kind = 0;
/// The `count` values, in any order.
pub const PM_INDICES_LIST: pm_indices_kind = 1;
/// The bits of `count` values: bit t of value w is index `first + 32 w + t`.
pub const PM_INDICES_MASK: pm_indices_kind = 2;

/// Indices of boxes. `pm_index`, `pm_index_range` and `pm_index_list` write them.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_indices {
    /// `PM_INDICES_...`.
    pub kind: pm_indices_kind,
    /// Of a range or a mask: the first one.
    pub first: u32,
    /// How many indices, or values.
    pub count: usize,
    /// Of a list or a mask.
    pub values: *const u32,
}

/// One index.
#[unsafe(no_mangle)]
pub extern "C" fn pm_index(index: u32) -> pm_indices {
    pm_index_range(index, 1)
}

/// Indices from `first` to before `first + count`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_index_range(first: u32, count: usize) -> pm_indices {
    pm_indices { kind: PM_INDICES_RANGE, first, count, values: std::ptr::null() }
}

/// Indices as a list, in any order.
#[unsafe(no_mangle)]
pub extern "C" fn pm_index_list(values: *const u32, count: usize) -> pm_indices {
    pm_indices { kind: PM_INDICES_LIST, first: 0, count, values }
}

/// # Safety
/// As [`array`], for as long as the edit is not answered.
unsafe fn indices_of(indices: pm_indices) -> Result<Indices<'static>, Failure> {
    let pm_indices { kind, first, count, values } = indices;
    // SAFETY: the caller's promise about pointers is passed on.
    let values = || unsafe { array(values, count) };
    Ok(match kind {
        PM_INDICES_RANGE => Indices::Range { first, count: index_count(count)? },
        PM_INDICES_LIST => Indices::List(values()?),
        PM_INDICES_MASK => Indices::Mask { first, words: values()? },
        _ => return Err(Failure::argument("no such kind of indices")),
    })
}

/// Adds to the edit of a scene. Its answer ends.
fn add(scene: pm_scene, say: impl FnOnce(&mut Draft) -> Result<(), Failure>) -> pm_code {
    call(|| scene.with(|scene| say(&mut scene.edited()?.draft)))
}

/// Sets the box of an index; inserts it where there is none. The box is copied. In a scene with margins it has the
/// usual one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_set(scene: pm_scene, index: u32, b: *const pm_box) -> pm_code {
    // SAFETY: the caller's promise about pointers is passed on.
    unsafe { set(scene, index, b, None) }
}

/// As `pm_scene_set`, with a margin of its own. A scene without margins knows that of 0 alone.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_set_margined(
    scene: pm_scene,
    index: u32,
    b: *const pm_box,
    margin: f32,
) -> pm_code {
    // SAFETY: the caller's promise about pointers is passed on.
    unsafe { set(scene, index, b, Some(margin)) }
}

/// # Safety
/// `b` is null or valid.
unsafe fn set(scene: pm_scene, index: u32, b: *const pm_box, margin: Option<f32>) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers is passed on.
        let b = as_boxes(&[unsafe { value(b) }?])[0];
        draft.set(index, b, margin.map(Margin::new).transpose()?);
        Ok(())
    })
}

/// Sets boxes: one for each index. The arrays are read where they lie, until the edit is answered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_set_all(
    scene: pm_scene,
    indices: pm_indices,
    boxes: *const pm_box,
    n: usize,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        let (indices, boxes) = unsafe { (indices_of(indices)?, as_boxes(array(boxes, n)?)) };
        draft.step(Step::Set(Sets { indices, boxes }));
        Ok(())
    })
}

/// As `pm_scene_set_all`, with a margin for all boxes, or one for each. Margins are copied.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_set_all_margined(
    scene: pm_scene,
    indices: pm_indices,
    boxes: *const pm_box,
    n: usize,
    margins: *const f32,
    margin_count: usize,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        let (indices, boxes, margins) = unsafe {
            (indices_of(indices)?, as_boxes(array(boxes, n)?), array(margins, margin_count)?)
        };
        let mut checked = Vec::with_capacity(boxes.len());
        match margins {
            [margin] => checked.resize(boxes.len(), Margin::new(*margin)?),
            margins => {
                for margin in margins {
                    checked.push(Margin::new(*margin)?);
                }
            }
        }
        draft.given.push(Given::Margined { indices, boxes, margins: checked });
        Ok(())
    })
}

/// Removes boxes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_remove(scene: pm_scene, indices: pm_indices) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        draft.step(Step::Remove(unsafe { indices_of(indices) }?));
        Ok(())
    })
}

/// Switches boxes off (they overlap nothing) or on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_switch(
    scene: pm_scene,
    indices: pm_indices,
    on: bool,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        draft.step(Step::Switch(unsafe { indices_of(indices) }?, on));
        Ok(())
    })
}

/// Makes boxes static (two static boxes are no pair) or not.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_make_static(
    scene: pm_scene,
    indices: pm_indices,
    is_static: bool,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        draft.step(Step::Static(unsafe { indices_of(indices) }?, is_static));
        Ok(())
    })
}

/// Gives boxes their tags: one for each index. A box that is inserted has a tag of zeros. Whether a box itself is
/// static, `pm_scene_make_static` says, and not its tag. The arrays are read where they lie, until the edit is
/// answered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_tag(
    scene: pm_scene,
    indices: pm_indices,
    tags: *const pm_tag,
    n: usize,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        let (indices, tags) = unsafe { (indices_of(indices)?, as_tags(array(tags, n)?)) };
        draft.tag(indices, tags);
        Ok(())
    })
}

/// The filters that tags name, in place of all before. They are copied.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_filters(
    scene: pm_scene,
    filters: *const pm_filter,
    n: usize,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers is passed on.
        draft.table = table(unsafe { array(filters, n) }?)?;
        draft.given.retain(|given| !matches!(given, Given::Table));
        draft.given.push(Given::Table);
        Ok(())
    })
}

/// Puts pairs of indices on the include list, or takes them off. The array is read where it lies, until the edit is
/// answered.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_include(
    scene: pm_scene,
    pairs: *const pm_pair,
    n: usize,
    on: bool,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        draft.step(Step::Include(as_pairs(unsafe { array(pairs, n) }?), on));
        Ok(())
    })
}

/// Puts pairs of indices on the exclude list, or takes them off, as `pm_scene_include` does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_exclude(
    scene: pm_scene,
    pairs: *const pm_pair,
    n: usize,
    on: bool,
) -> pm_code {
    add(scene, |draft| {
        // SAFETY: the caller's promise about pointers, until the edit is answered, is passed on.
        draft.step(Step::Exclude(as_pairs(unsafe { array(pairs, n) }?), on));
        Ok(())
    })
}

/// Forgets the edit that is being written.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_discard(scene: pm_scene) -> pm_code {
    add(scene, |draft| {
        draft.clear();
        Ok(())
    })
}

/// Which answer is wanted of an edit: one of `PM_REPORT_...`.
pub type pm_report = u32;
/// Pairs that began and ended since the last answer that was waited for.
pub const PM_REPORT_CHANGES: pm_report = 0;
/// Pairs of now with at least one box that the edit set, switched or flagged.
pub const PM_REPORT_MOVED: pm_report = 1;
/// All pairs of now.
pub const PM_REPORT_ALL: pm_report = 2;
/// Nothing: the edit is applied.
pub const PM_REPORT_NOTHING: pm_report = 3;

fn report_of(report: pm_report) -> Result<Report, Failure> {
    Ok(match report {
        PM_REPORT_CHANGES => Report::Changes,
        PM_REPORT_MOVED => Report::Moved,
        PM_REPORT_ALL => Report::All,
        PM_REPORT_NOTHING => Report::Nothing,
        _ => return Err(Failure::argument("no such answer")),
    })
}

/// Sends the edit that was written. The answer before ends, and with it its lists.
fn send(scene: &mut super::Scene, report: pm_report) -> Result<(), Failure> {
    let report = report_of(report)?;
    scene.edited()?;
    scene.state.submit(report)
}

/// Sends the edit that was written: removals first, then boxes that are set, then switches and static flags in
/// their order, then what is about rules. A daemon works on it while this thread does something else.
/// Whatever is returned, the edit is written no more.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_submit(scene: pm_scene, report: pm_report) -> pm_code {
    call(|| scene.with(|scene| send(scene, report)))
}

/// Waits for the answer to what was submitted, as long as the session's deadline allows, and for a shared scene
/// until its tick ends. That acknowledges it: what it reports is not reported again. After an error the edit is applied,
/// and the next answer makes up for this one.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_wait(scene: pm_scene) -> pm_code {
    call(|| scene.with(|scene| scene.state.wait()))
}

/// `pm_scene_submit` and `pm_scene_wait`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_commit(scene: pm_scene, report: pm_report) -> pm_code {
    call(|| {
        scene.with(|scene| {
            send(scene, report)?;
            scene.state.wait()
        })
    })
}
