//! Persistent scenes: `pm_scene`.
//!
//! ```text
//! edited   a scene with its edit: written, under way, or answered
//! edit     the functions that write an edit
//! answer   the functions that send it and wait for its answer
//! asked    the functions that ask a scene, and change nothing
//! shared   the functions of scenes that several processes write
//! ```
#![allow(unsafe_code)]

mod answer;
mod asked;
mod edit;
mod edited;
mod shared;

use std::ffi::c_char;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::ops::Range;

use bytemuck::cast;
use pairmask::cast::Hit;
use pairmask::{Margin, SceneOptions, SnapshotId};

use self::answer::Lists;
use self::edited::{Edited, State};
use crate::call::call;
use crate::code::pm_code::{self, PM_ERR_ABSENT, PM_ERR_ARGUMENT};
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{In, Out, raw};
use crate::session::pm_session;
use crate::values::{if_any, pm_box, pm_range};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_scene {
    pub id: u64,
}

/// What a `pm_scene` names.
pub struct Scene {
    state: State,
    lists: Lists,
    /// What the last query has found, and the last cast.
    found: Vec<[u32; 2]>,
    hits: Vec<Hit>,
    /// User data that were asked for last.
    user_data: Vec<u64>,
    /// What this member had leased when it was asked last.
    leases: Vec<pm_range>,
}

impl Scene {
    fn new(scene: pairmask::Scene) -> Self {
        let (lists, found, hits, user_data, leases) = Default::default();
        Self { state: State::new(scene), lists, found, hits, user_data, leases }
    }
}

/// Changes a scene, or the edit of it that is being written. Its answer ends.
fn change(scene: pm_scene, work: impl FnOnce(&mut Edited) -> Result<(), Failure>) -> pm_code {
    call(|| scene.with(|scene| work(scene.state.end()?)))
}

/// Ranges as a program sees them.
fn to_ranges(ranges: &[Range<u32>], out: &mut Vec<pm_range>) {
    out.clear();
    out.extend(ranges.iter().map(to_range));
}

fn to_range(range: &Range<u32>) -> pm_range {
    pm_range { first: range.start, count: range.end - range.start }
}

pub type pm_margins = u32;
pub const PM_MARGINS_NONE: pm_margins = 0;
pub const PM_MARGINS_EXACT: pm_margins = 1;
pub const PM_MARGINS_NEAR: pm_margins = 2;

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_scene_options {
    pub struct_size: usize,
    pub most_boxes: u32,
    pub threads: u32,
    pub margins: pm_margins,
    pub usual_margin: f32,
}

growing!(pm_scene_options);

fn options_of(given: &pm_scene_options) -> Result<SceneOptions, Failure> {
    let mut options = SceneOptions::default();
    options.most_boxes = if_any(given.most_boxes);
    options.threads = if_any(given.threads).map(|threads| threads as usize);
    let near_pairs = match given.margins {
        PM_MARGINS_NONE => return Ok(options),
        PM_MARGINS_EXACT => false,
        PM_MARGINS_NEAR => true,
        _ => return Err(Failure::argument("no such margins")),
    };
    Ok(options.with_margin(Margin::new(given.usual_margin)?).with_near_pairs(near_pairs))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_create(
    session: pm_session,
    options: In<pm_scene_options>,
    scene: Out<pm_scene>,
) -> pm_code {
    scene.give(|| {
        let options = options_of(&options.growing()?)?;
        pm_scene::new(Scene::new(session.with(|s| Ok(s.scene(options)?))?))
    })
}

const NO_PATH: Failure = Failure::new(PM_ERR_ARGUMENT, "a path is null");

/// The error of a file.
fn of_file(error: std::io::Error) -> pairmask::Error {
    pairmask::SceneFileError::from(error).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_save(scene: pm_scene, path: In<c_char>) -> pm_code {
    change(scene, |edited| {
        let path = path.text()?.ok_or(NO_PATH)?;
        Ok(edited.scene.save(BufWriter::new(File::create(path).map_err(of_file)?))?)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_load_scene(
    session: pm_session,
    options: In<pm_scene_options>,
    path: In<c_char>,
    scene: Out<pm_scene>,
) -> pm_code {
    scene.give(|| {
        let options = options_of(&options.growing()?)?;
        let path = path.text()?.ok_or(NO_PATH)?;
        let file = BufReader::new(File::open(path).map_err(of_file)?);
        pm_scene::new(Scene::new(session.with(|s| Ok(s.load_scene(options, file)?))?))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_drop(scene: pm_scene) -> pm_code {
    scene.drop()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_resync(scene: pm_scene) -> pm_code {
    change(scene, |edited| {
        edited.scene.resync();
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_shift_origin(scene: pm_scene, by: In<f32>) -> pm_code {
    change(scene, |edited| {
        let &[x, y, z] = by.array(3)? else { return Err(Failure::argument("three numbers")) };
        Ok(edited.scene.shift_origin([x, y, z])?)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_take_snapshot(scene: pm_scene, snapshot: Out<u64>) -> pm_code {
    snapshot.give(|| scene.with(|scene| Ok(scene.state.end()?.scene.snapshot()?.number())))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_restore(scene: pm_scene, snapshot: u64) -> pm_code {
    change(scene, |edited| Ok(edited.scene.restore(SnapshotId::from_number(snapshot))?))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_forget_snapshot(scene: pm_scene, snapshot: u64) -> pm_code {
    change(scene, |edited| Ok(edited.scene.forget_snapshot(SnapshotId::from_number(snapshot))?))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_get(scene: pm_scene, index: u32, b: Out<pm_box>) -> pm_code {
    b.give(|| {
        let found = scene.with(|scene| scene.state.look(|scene| scene.get(index)))?;
        found.map(cast).ok_or(Failure::new(PM_ERR_ABSENT, "the index has no box"))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_get_user_data(
    scene: pm_scene,
    indices: In<u32>,
    n: usize,
    user_data: Out<*const u64>,
) -> pm_code {
    user_data.give(|| {
        let indices = indices.array(n)?;
        scene.with(|Scene { state, user_data, .. }| {
            state.look(|scene| {
                user_data.clear();
                user_data.extend(indices.iter().map(|index| scene.user_data(*index)));
            })?;
            Ok(raw(user_data).0)
        })
    })
}

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_scene_info {
    pub struct_size: usize,
    pub boxes: u64,
    pub allocated_bytes: u64,
    pub daemon_bytes: u64,
    pub edits: u64,
    pub requests: u64,
    pub set: u64,
    pub sent: u64,
    pub most_boxes: u64,
    pub tick_deadline_ns: u64,
    pub leases: *const pm_range,
    pub lease_count: usize,
}

growing!(pm_scene_info);

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_get_info(scene: pm_scene, info: Out<pm_scene_info>) -> pm_code {
    info.give_growing(|| {
        scene.with(|scene| {
            let Scene { state, leases: memory, .. } = scene;
            state.look(|scene| {
                to_ranges(scene.leases(), memory);
                let (leases, lease_count) = raw(memory);
                let (stats, deadline) =
                    (scene.margin_stats().unwrap_or_default(), scene.tick_deadline());
                pm_scene_info {
                    boxes: scene.len() as u64,
                    allocated_bytes: scene.allocated_bytes() as u64,
                    daemon_bytes: scene.daemon_bytes(),
                    edits: stats.edits,
                    requests: stats.requests,
                    set: stats.set,
                    sent: stats.sent,
                    most_boxes: u64::from(scene.most_boxes()),
                    tick_deadline_ns: deadline.map_or(0, |time| time.as_nanos() as u64),
                    leases,
                    lease_count,
                    ..Default::default()
                }
            })
        })
    })
}
