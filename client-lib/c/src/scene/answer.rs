//! The functions that read the answer to an edit.
#![allow(unsafe_code)]

use std::ffi::c_void;

use bytemuck::{Pod, Zeroable};
use pairmask::{PairList, SceneAnswer};

use super::{Scene, pm_scene};
use crate::call::call;
use crate::code::pm_code;
use crate::facts::{name_of, pm_name};
use crate::failure::Failure;
use crate::mask::{pm_visit, visitor};
use crate::memory::{check_out, write, write_growing, write_list};
use crate::session::{pm_served_by, served_by_number};
use crate::spares::Decoded;
use crate::values::{pm_ended, pm_pair, pm_range, to_ended, to_pairs};

/// Facts about the answer to an edit.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_answer {
    /// `sizeof(pm_answer)`, set by the caller.
    pub struct_size: usize,
    /// 1 where changes were asked for and `pm_scene_pairs` has all pairs instead: forget the pairs that you
    /// know. Else 0.
    pub is_resync: u32,
    /// What answered.
    pub served_by: pm_served_by,
    /// Pairs that began.
    pub begun: u64,
    /// Pairs that ended.
    pub ended: u64,
    /// Pairs that `pm_scene_pairs` has.
    pub pairs: u64,
    /// Pairs of the whole scene; `UINT64_MAX` where the answer does not know.
    pub pair_count: u64,
    /// Pairs that were not tested.
    pub skipped_pairs: u64,
    /// Of a shared scene: the tick, from 1.
    pub tick: u64,
    /// Of a shared scene: leases of writers that were late.
    pub late: u64,
    /// Name of the engine.
    pub engine: pm_name,
}

/// Facts about the answer. Set `answer->struct_size` first.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_answer(scene: pm_scene, answer: *mut pm_answer) -> pm_code {
    call(|| {
        check_out(answer)?;
        let facts = scene.with(|scene| {
            scene.state.read(|answer| pm_answer {
                struct_size: 0,
                is_resync: u32::from(answer.is_resync()),
                served_by: served_by_number(answer.served_by()),
                begun: answer.begun().len() as u64,
                ended: answer.ended().len() as u64,
                pairs: answer.pairs().len() as u64,
                pair_count: answer.pair_count().unwrap_or(u64::MAX),
                skipped_pairs: answer.skipped().pairs(),
                tick: answer.tick().unwrap_or(0),
                late: answer.late().len() as u64,
                engine: name_of(answer.engine()),
            })
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_growing(answer, &facts) }
    })
}

/// Which list of pairs.
#[derive(Clone, Copy)]
enum Which {
    Begun,
    Pairs,
}

fn list<'a>(answer: &'a SceneAnswer<'_>, which: Which) -> PairList<'a> {
    match which {
        Which::Begun => answer.begun(),
        Which::Pairs => answer.pairs(),
    }
}

/// A list of the answer, where it lies if that is this process's memory, else decoded once.
fn pairs_of(scene: &mut Scene, which: Which) -> Result<(*const pm_pair, usize), Failure> {
    let Scene { state, lists } = scene;
    let decoded: &mut Decoded = match which {
        Which::Begun => &mut lists.begun,
        Which::Pairs => &mut lists.pairs,
    };
    state.read(|answer| {
        let list = list(answer, which);
        let found = match list.own_list() {
            Some(own) => own,
            None => decoded.get(|out| list.for_each_slice(|some| out.extend_from_slice(some))),
        };
        (to_pairs(found).as_ptr(), found.len())
    })
}

unsafe fn read(
    scene: pm_scene,
    which: Which,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || scene.with(|scene| pairs_of(scene, which));
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(pairs, count, find) }
    })
}

/// Pairs that began, for `PM_REPORT_CHANGES`, as an array that lives until the answer ends: with the next call
/// that writes or sends an edit, queries the scene, or leases.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_begun(
    scene: pm_scene,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    // SAFETY: the caller's promise about pointers is passed on.
    unsafe { read(scene, Which::Begun, pairs, count) }
}

/// Pairs of now, for `PM_REPORT_ALL`, `PM_REPORT_MOVED` and a resync, as an array that lives until the answer ends.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_pairs(
    scene: pm_scene,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    // SAFETY: the caller's promise about pointers is passed on.
    unsafe { read(scene, Which::Pairs, pairs, count) }
}

/// Pairs that ended, for `PM_REPORT_CHANGES`, as an array that lives until the answer ends.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_ended(
    scene: pm_scene,
    ended: *mut *const pm_ended,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || {
            scene.with(|scene| {
                let Scene { state, lists } = &mut **scene;
                if lists.ended.is_none() {
                    let reported = state.read(|answer| answer.ended().map(to_ended).collect())?;
                    lists.ended = Some(reported);
                }
                state.read(|_| {
                    lists
                        .ended
                        .as_deref()
                        .map_or((std::ptr::null(), 0), |all| (all.as_ptr(), all.len()))
                })
            })
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(ended, count, find) }
    })
}

unsafe fn visit_list(scene: pm_scene, which: Which, visit: pm_visit, user: *mut c_void) -> pm_code {
    call(|| {
        let visit = visitor(visit)?;
        scene.with(|scene| {
            scene.state.read(|answer| {
                list(answer, which).for_each_slice(|pairs| {
                    // SAFETY: the callback is the caller's, who gives what it needs in `user`.
                    unsafe { visit(user, to_pairs(pairs).as_ptr(), pairs.len()) };
                });
            })
        })
    })
}

/// Calls `visit` with the pairs that began, some at a time, without a copy of the list.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_for_each_begun(
    scene: pm_scene,
    visit: pm_visit,
    user: *mut c_void,
) -> pm_code {
    // SAFETY: the caller's promise about the callback is passed on.
    unsafe { visit_list(scene, Which::Begun, visit, user) }
}

/// Calls `visit` with the pairs of now, some at a time, without a copy of the list.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_for_each_pair(
    scene: pm_scene,
    visit: pm_visit,
    user: *mut c_void,
) -> pm_code {
    // SAFETY: the caller's promise about the callback is passed on.
    unsafe { visit_list(scene, Which::Pairs, visit, user) }
}

/// Leases of writers that had not committed when the tick ended, of a shared scene: at most `capacity` of them are
/// written, and `count` is how many there are.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_late(
    scene: pm_scene,
    ranges: *mut pm_range,
    capacity: usize,
    count: *mut usize,
) -> pm_code {
    call(|| {
        check_out(count)?;
        let late = scene.with(|scene| scene.state.read(|answer| answer.late().to_vec()))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            super::shared::write_ranges(&late, ranges, capacity)?;
            write(count, late.len())
        }
    })
}
