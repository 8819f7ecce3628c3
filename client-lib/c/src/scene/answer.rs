//! The functions that send an edit, and wait for its answer.
#![allow(unsafe_code)]

use pairmask::{Report, SceneAnswer};

use super::{Scene, pm_scene, to_ranges};
use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{Out, raw};
use crate::values::{
    name_of, pm_ended, pm_name, pm_pair, pm_range, pm_served_by, served_by_number, to_ended,
    to_pairs,
};

pub type pm_report = u32;
pub const PM_REPORT_CHANGES: pm_report = 0;
pub const PM_REPORT_MOVED: pm_report = 1;
pub const PM_REPORT_ALL: pm_report = 2;
pub const PM_REPORT_NOTHING: pm_report = 3;

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_answer {
    pub struct_size: usize,
    pub is_resync: u32,
    pub served_by: pm_served_by,
    pub begun: *const pm_pair,
    pub begun_count: usize,
    pub ended: *const pm_ended,
    pub ended_count: usize,
    pub pairs: *const pm_pair,
    pub pair_count: usize,
    pub late: *const pm_range,
    pub late_count: usize,
    pub all_pairs: u64,
    pub skipped_pairs: u64,
    pub tick: u64,
    pub engine: pm_name,
}

growing!(pm_answer);

/// What an answer was decoded to, once: other processes may write what it lies in.
#[derive(Default)]
pub struct Lists {
    begun: Vec<[u32; 2]>,
    pairs: Vec<[u32; 2]>,
    ended: Vec<pm_ended>,
    late: Vec<pm_range>,
}

impl Lists {
    /// Decodes an answer, but for lists in this process's memory.
    fn read(&mut self, answer: &SceneAnswer<'_>) {
        for (list, memory) in [(answer.begun(), &mut self.begun), (answer.pairs(), &mut self.pairs)]
        {
            memory.clear();
            if list.own_list().is_none() {
                list.for_each_slice(|some| memory.extend_from_slice(some));
            }
        }
        self.ended.clear();
        self.ended.extend(answer.ended().map(to_ended));
        to_ranges(answer.late(), &mut self.late);
    }
}

/// The answer, whose lists were decoded.
fn answer_of(scene: &Scene) -> Result<pm_answer, Failure> {
    let Scene { state, lists, .. } = scene;
    state.read(|answer| {
        let (begun, begun_count) = raw(to_pairs(answer.begun().own_list().unwrap_or(&lists.begun)));
        let (pairs, pair_count) = raw(to_pairs(answer.pairs().own_list().unwrap_or(&lists.pairs)));
        let (ended, ended_count) = raw(&lists.ended);
        let (late, late_count) = raw(&lists.late);
        pm_answer {
            is_resync: u32::from(answer.is_resync()),
            served_by: served_by_number(answer.served_by()),
            begun,
            begun_count,
            ended,
            ended_count,
            pairs,
            pair_count,
            late,
            late_count,
            all_pairs: answer.pair_count().unwrap_or(u64::MAX),
            skipped_pairs: answer.skipped().pairs(),
            tick: answer.tick().unwrap_or(0),
            engine: name_of(answer.engine()),
            ..Default::default()
        }
    })
}

/// Sends the edit that was written. The answer before ends, and with it its lists.
fn send(scene: &mut Scene, report: pm_report) -> Result<(), Failure> {
    let report = match report {
        PM_REPORT_CHANGES => Report::Changes,
        PM_REPORT_MOVED => Report::Moved,
        PM_REPORT_ALL => Report::All,
        PM_REPORT_NOTHING => Report::Nothing,
        _ => return Err(Failure::argument("no such answer")),
    };
    scene.state.submit(report)
}

/// Waits for an answer, once `first` has succeeded.
fn wait(
    scene: pm_scene,
    answer: Out<pm_answer>,
    first: impl FnOnce(&mut Scene) -> Result<(), Failure>,
) -> pm_code {
    call(|| {
        let answer = answer.if_any();
        answer.map_or(Ok(()), Out::check_growing)?;
        scene.with(|scene| {
            first(scene)?;
            if scene.state.wait()? {
                scene.state.read(|answer| scene.lists.read(answer))?;
            }
            answer.map_or(Ok(()), |answer| answer.write_growing(&answer_of(scene)?))
        })
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_submit(scene: pm_scene, report: pm_report) -> pm_code {
    call(|| scene.with(|scene| send(scene, report)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_wait(scene: pm_scene, answer: Out<pm_answer>) -> pm_code {
    wait(scene, answer, |_| Ok(()))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_commit(
    scene: pm_scene,
    report: pm_report,
    answer: Out<pm_answer>,
) -> pm_code {
    wait(scene, answer, |scene| send(scene, report))
}
