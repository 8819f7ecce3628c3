//! The functions that write an edit.
#![allow(unsafe_code)]

use bytemuck::{cast, cast_slice};
use pairmask::Margin;
use pairmask_core::scene::{FilterDataSets, Indices, Sets, Step, UserDataSets};

use super::edited::Given;
use super::{change, pm_scene};
use crate::code::pm_code;
use crate::failure::Failure;
use crate::filters::table;
use crate::memory::In;
use crate::values::{index_count, pm_box, pm_filter, pm_filter_data, pm_pair};

pub type pm_indices_kind = u32;
pub const PM_INDICES_RANGE: pm_indices_kind = 0;
pub const PM_INDICES_LIST: pm_indices_kind = 1;
pub const PM_INDICES_MASK: pm_indices_kind = 2;

#[derive(Clone, Copy)]
#[repr(C)]
pub struct pm_indices {
    pub kind: pm_indices_kind,
    pub first: u32,
    pub count: usize,
    pub values: In<u32>,
}

impl pm_indices {
    /// The library's, which are valid until the edit is answered.
    fn read(self) -> Result<Indices<'static>, Failure> {
        let Self { kind, first, count, values } = self;
        Ok(match kind {
            PM_INDICES_RANGE => Indices::Range { first, count: index_count(count)? },
            PM_INDICES_LIST => Indices::List(values.array(count)?),
            PM_INDICES_MASK => Indices::Mask { first, words: values.array(count)? },
            _ => return Err(Failure::argument("no such kind of indices")),
        })
    }
}

/// Adds to the edit of a scene. Its answer ends.
fn add(scene: pm_scene, make: impl FnOnce() -> Result<Given, Failure>) -> pm_code {
    change(scene, |edited| {
        edited.steps.push(make()?);
        Ok(())
    })
}

/// Adds a step that borrows nothing of this library.
fn step(scene: pm_scene, step: impl FnOnce() -> Result<Step<'static>, Failure>) -> pm_code {
    add(scene, || step().map(Given::Step))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_set(
    scene: pm_scene,
    index: u32,
    b: In<pm_box>,
    margin: In<f32>,
) -> pm_code {
    add(scene, || {
        let (b, margin) = (cast(b.value()?), margin.if_any()?);
        Ok(Given::Single(index, b, margin.map(Margin::new).transpose()?))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_set_all(
    scene: pm_scene,
    indices: pm_indices,
    boxes: In<pm_box>,
    n: usize,
    margins: In<f32>,
    margin_count: usize,
) -> pm_code {
    add(scene, || {
        let (indices, boxes) = (indices.read()?, cast_slice(boxes.array(n)?));
        let margins = margins.array(margin_count)?.iter().map(|margin| Margin::new(*margin));
        let margins = margins.collect::<Result<Vec<_>, _>>()?;
        Ok(if margins.is_empty() {
            Given::Step(Step::Set(Sets { indices, boxes }))
        } else {
            Given::Margined { indices, boxes, margins }
        })
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_remove(scene: pm_scene, indices: pm_indices) -> pm_code {
    step(scene, || Ok(Step::Remove(indices.read()?)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_set_enabled(scene: pm_scene, indices: pm_indices, on: bool) -> pm_code {
    step(scene, || Ok(Step::Enable(indices.read()?, on)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_make_static(
    scene: pm_scene,
    indices: pm_indices,
    is_static: bool,
) -> pm_code {
    step(scene, || Ok(Step::Static(indices.read()?, is_static)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_set_filter(
    scene: pm_scene,
    indices: pm_indices,
    filter_data: In<pm_filter_data>,
    n: usize,
) -> pm_code {
    step(scene, || {
        Ok(Step::FilterData(FilterDataSets {
            indices: indices.read()?,
            filter_data: cast_slice(filter_data.array(n)?),
        }))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_set_user_data(
    scene: pm_scene,
    indices: pm_indices,
    user_data: In<u64>,
    n: usize,
) -> pm_code {
    step(scene, || {
        let (indices, user_data) = (indices.read()?, cast_slice(user_data.array(n)?));
        Ok(Step::UserData(UserDataSets { indices, user_data }))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_filter_table(
    scene: pm_scene,
    filters: In<pm_filter>,
    n: usize,
) -> pm_code {
    add(scene, || Ok(Given::Table(table(filters, n)?)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_include(
    scene: pm_scene,
    pairs: In<pm_pair>,
    n: usize,
    on: bool,
) -> pm_code {
    step(scene, || Ok(Step::Include(cast_slice(pairs.array(n)?), on)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_exclude(
    scene: pm_scene,
    pairs: In<pm_pair>,
    n: usize,
    on: bool,
) -> pm_code {
    step(scene, || Ok(Step::Exclude(cast_slice(pairs.array(n)?), on)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_discard(scene: pm_scene) -> pm_code {
    change(scene, |edited| {
        edited.steps.clear();
        Ok(())
    })
}
