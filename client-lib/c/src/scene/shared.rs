//! The functions of scenes that several processes write.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::time::Duration;

use pairmask::{AtEnd, Margin, SceneOptions, Scope};

use super::{PM_MARGINS_NEAR, PM_MARGINS_NONE, Scene, change, pm_margins, pm_scene, to_range};
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{In, Out};
use crate::session::pm_session;
use crate::values::{if_any, pm_range};

pub type pm_at_end = u32;
pub const PM_AT_END_ANY: pm_at_end = 0;
pub const PM_AT_END_REMOVE: pm_at_end = 1;
pub const PM_AT_END_KEEP: pm_at_end = 2;

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_join_options {
    pub struct_size: usize,
    pub tick_deadline_ns: u64,
    pub most_boxes: u32,
    pub at_end: pm_at_end,
    pub all_pairs: u32,
    pub margins: pm_margins,
    pub usual_margin: f32,
}

growing!(pm_join_options);

fn options_of(given: &pm_join_options) -> Result<SceneOptions, Failure> {
    let mut options = SceneOptions::default();
    options.most_boxes = if_any(given.most_boxes);
    options.tick_deadline = if_any(given.tick_deadline_ns).map(Duration::from_nanos);
    options.at_end = match given.at_end {
        PM_AT_END_ANY => None,
        PM_AT_END_REMOVE => Some(AtEnd::Remove),
        PM_AT_END_KEEP => Some(AtEnd::Keep),
        _ => return Err(Failure::argument("no such end")),
    };
    options.margin = match given.margins {
        PM_MARGINS_NONE => None,
        PM_MARGINS_NEAR => Some(Margin::new(given.usual_margin)?),
        _ => return Err(Failure::argument("a shared scene has no such margins")),
    };
    options.scope = if given.all_pairs == 0 { Scope::Own } else { Scope::All };
    Ok(options)
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_join(
    session: pm_session,
    name: In<c_char>,
    options: In<pm_join_options>,
    scene: Out<pm_scene>,
) -> pm_code {
    scene.give(|| {
        let name = name.text()?.ok_or(Failure::argument("the name is null"))?;
        let options = options_of(&options.growing()?)?.with_shared(name);
        pm_scene::new(Scene::new(session.with(|s| Ok(s.scene(options)?))?))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_lease(scene: pm_scene, range: pm_range) -> pm_code {
    change(scene, |edited| {
        let end = range.first.checked_add(range.count);
        let end = end.ok_or(Failure::argument("the range ends beyond 2^32 - 1"))?;
        Ok(edited.scene.lease(range.first..end)?)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_lease_any(scene: pm_scene, count: u32, range: Out<pm_range>) -> pm_code {
    range.give(|| scene.with(|scene| Ok(to_range(&scene.state.end()?.scene.lease_any(count)?))))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_give_back(scene: pm_scene, first: u32) -> pm_code {
    change(scene, |edited| Ok(edited.scene.give_back(first)?))
}
