//! The functions of scenes that several processes write.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::ops::Range;
use std::time::Duration;

use pairmask::{AtEnd, Error, JoinOptions, Margin, Scope};

use super::{PM_MARGINS_NEAR, PM_MARGINS_NONE, Scene, pm_margins, pm_scene};
use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::memory::{Growing, check_out, growing, text, write};
use crate::session::pm_session;
use crate::values::pm_range;

/// What becomes of a dead writer's boxes: one of `PM_AT_END_...`.
pub type pm_at_end = u32;
/// As the others say; they are removed where nobody says anything.
pub const PM_AT_END_ANY: pm_at_end = 0;
/// They are removed.
pub const PM_AT_END_REMOVE: pm_at_end = 1;
/// They stay, for who leases their indices next.
pub const PM_AT_END_KEEP: pm_at_end = 2;

/// What a member asks of a shared scene. Zeros leave it open: the first member or the daemon decides.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_join_options {
    /// `sizeof(pm_join_options)`.
    pub struct_size: usize,
    /// How long a tick is open after its first commit, at the most, ns: 100 ms unless a member says so, 10 s at most.
    pub tick_deadline_ns: u64,
    /// Indices are below this.
    pub most_boxes: u32,
    /// `PM_AT_END_...`.
    pub at_end: pm_at_end,
    /// 1 for a member that is told of all pairs; 0 for those of its own boxes.
    pub all_pairs: u32,
    /// `PM_MARGINS_NEAR` for boxes with margins, or `PM_MARGINS_NONE`.
    pub margins: pm_margins,
    /// The margin of boxes that are set without one.
    pub usual_margin: f32,
    /// Zero.
    pub reserved: u32,
}

// SAFETY: it is `repr(C)` and begins with its size; numbers have no invalid bit patterns.
unsafe impl Growing for pm_join_options {}

fn options_of(given: &pm_join_options) -> Result<JoinOptions, Failure> {
    let mut options = JoinOptions::default();
    if given.most_boxes > 0 {
        options = options.with_most_boxes(given.most_boxes);
    }
    if given.tick_deadline_ns > 0 {
        options = options.with_tick_deadline(Duration::from_nanos(given.tick_deadline_ns));
    }
    options = match given.at_end {
        PM_AT_END_ANY => options,
        PM_AT_END_REMOVE => options.with_at_end(AtEnd::Remove),
        PM_AT_END_KEEP => options.with_at_end(AtEnd::Keep),
        _ => return Err(Failure::argument("no such end")),
    };
    options = match given.margins {
        PM_MARGINS_NONE => options,
        PM_MARGINS_NEAR => options.with_usual_margin(Margin::new(given.usual_margin)?),
        _ => return Err(Failure::argument("a shared scene has no such margins")),
    };
    Ok(if given.all_pairs == 0 { options } else { options.with_scope(Scope::All) })
}

/// Joins a scene that several processes write, by its name: 1 to 64 letters, digits and `-_.:/`. It needs a daemon.
/// `options` may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_join(
    session: pm_session,
    name: *const c_char,
    options: *const pm_join_options,
    scene: *mut pm_scene,
) -> pm_code {
    call(|| {
        check_out(scene)?;
        let open = pm_join_options {
            struct_size: size_of::<pm_join_options>(),
            tick_deadline_ns: 0,
            most_boxes: 0,
            at_end: PM_AT_END_ANY,
            all_pairs: 0,
            margins: PM_MARGINS_NONE,
            usual_margin: 0.0,
            reserved: 0,
        };
        // SAFETY: the caller's promise about pointers is passed on.
        let (name, given) = unsafe { (text(name)?, growing(options, open)?) };
        let name = name.ok_or(Failure::argument("the name is null"))?;
        let options = options_of(&given)?;
        let made = session.with(|s| {
            let shared = s.session.join_scene(name, options)?;
            Ok(Scene::new(shared, &s.spares))
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(scene, pm_scene::new(Box::new(made))?) }
    })
}

/// Uses a scene. Its answer ends.
fn with_scene<R>(
    scene: pm_scene,
    work: impl FnOnce(&mut pairmask::Scene) -> Result<R, Error>,
) -> Result<R, Failure> {
    scene.with(|scene| Ok(work(&mut scene.edited()?.scene)?))
}

/// Leases a range of indices: this member alone may set boxes there.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_lease(scene: pm_scene, range: pm_range) -> pm_code {
    call(|| {
        let end = range.first.checked_add(range.count);
        let end = end.ok_or(Failure::argument("the range ends beyond 2^32 - 1"))?;
        with_scene(scene, |scene| scene.lease(range.first..end))
    })
}

/// Leases the lowest free range of so many indices. Which one that is depends on who came first.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_lease_any(
    scene: pm_scene,
    count: u32,
    range: *mut pm_range,
) -> pm_code {
    call(|| {
        check_out(range)?;
        let leased = with_scene(scene, |scene| scene.lease_any(count))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(range, to_range(&leased)) }
    })
}

/// Gives back the lease that begins at an index. Its boxes are removed.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_give_back(scene: pm_scene, first: u32) -> pm_code {
    call(|| with_scene(scene, |scene| scene.give_back(first)))
}

/// The ranges that this member has leased: at most `capacity` of them are written, and `count` is how many there
/// are.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_leases(
    scene: pm_scene,
    ranges: *mut pm_range,
    capacity: usize,
    count: *mut usize,
) -> pm_code {
    call(|| {
        check_out(count)?;
        let leases = scene.with(|scene| scene.state.look(|scene| scene.leases().to_vec()))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            write_ranges(&leases, ranges, capacity)?;
            write(count, leases.len())
        }
    })
}

/// What holds in a shared scene: indices are below `most_boxes`, and a tick is open for `tick_deadline_ns` after its
/// first commit, at the most.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_terms(
    scene: pm_scene,
    most_boxes: *mut u32,
    tick_deadline_ns: *mut u64,
) -> pm_code {
    call(|| {
        check_out(most_boxes)?;
        check_out(tick_deadline_ns)?;
        let (most, deadline) = with_scene(scene, |scene| {
            let deadline = scene.tick_deadline().ok_or(Error::NotShared)?;
            Ok((scene.most_boxes(), deadline))
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            write(most_boxes, most)?;
            write(tick_deadline_ns, deadline.as_nanos() as u64)
        }
    })
}

fn to_range(range: &Range<u32>) -> pm_range {
    pm_range { first: range.start, count: range.end - range.start }
}

/// Writes as many ranges as there is room for.
///
/// # Safety
/// `out` is null or valid for `capacity` ranges.
pub(super) unsafe fn write_ranges(
    ranges: &[Range<u32>],
    out: *mut pm_range,
    capacity: usize,
) -> Result<(), Failure> {
    for (at, range) in ranges.iter().take(capacity).enumerate() {
        // SAFETY: `at` is below `capacity`; the caller's promise about pointers is passed on.
        unsafe { write(out.wrapping_add(at), to_range(range)) }?;
    }
    Ok(())
}
