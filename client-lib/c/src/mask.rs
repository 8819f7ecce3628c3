//! Frames under way and their answers: `pm_pending`, `pm_mask`.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::ptr::null;
use std::time::Duration;

use pairmask::filters::World;
use pairmask::{Error, PairMask, PendingFrame};
use pairmask_core::mask::{Encoding, MaskView};

use crate::call::call;
use crate::code::pm_code;
use crate::facts::{pm_frame_info, pm_word};
use crate::failure::Failure;
use crate::handles::handle;
use crate::memory::{check_out, write, write_growing, write_list};
use crate::spares::{Decoded, Spares};
use crate::values::{pm_pair, to_pairs};

/// A frame under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_pending {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_pending` names.
pub struct Pending {
    pub pending: PendingFrame,
    pub spares: Spares,
}

handle!(pm_pending is Pending);

/// The overlapping pairs of a frame. It holds one of its session's three places until it is dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_mask {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_mask` names.
pub struct Mask {
    mask: PairMask,
    decoded: Decoded,
}

impl Mask {
    pub fn new(mask: PairMask, spares: Spares) -> Self {
        Self { mask, decoded: Decoded::new(spares) }
    }
}

handle!(pm_mask is Mask);

/// Called with some pairs at a time. The pairs are the callback's until it returns. It may not throw, nor use
/// the handle that it is called for.
pub type pm_visit =
    Option<unsafe extern "C" fn(user: *mut c_void, pairs: *const pm_pair, count: usize)>;

/// The callback, given.
pub fn visitor(
    visit: pm_visit,
) -> Result<unsafe extern "C" fn(*mut c_void, *const pm_pair, usize), Failure> {
    visit.ok_or(Failure::argument("the callback is null"))
}

/// Waits for the pairs, as long as the session's deadline allows. The handle names nothing any more, whatever
/// is returned. With `PM_BACKEND_AUTO` no failure of the daemon is an error: this process answers then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_pending_wait(pending: pm_pending, mask: *mut pm_mask) -> pm_code {
    call(|| {
        let Pending { pending, spares } = pending.remove()?;
        check_out(mask)?;
        let made = Mask::new(pending.wait()?, spares);
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(mask, pm_mask::new(made)?) }
    })
}

/// Waits for the pairs, at most so many nanoseconds; with 0 it looks whether they have come. After
/// `PM_ERR_TIMEOUT` the frame is still under way, and after `PM_ERR_ARGUMENT` and `PM_ERR_BUSY` nothing was
/// done; else the handle names nothing any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_pending_wait_timeout(
    pending: pm_pending,
    timeout_ns: u64,
    mask: *mut pm_mask,
) -> pm_code {
    call(|| {
        check_out(mask)?;
        let answer = pending.with(|pending| {
            let answer = pending.pending.wait_timeout(Duration::from_nanos(timeout_ns));
            Ok(answer.map(|mask| Mask::new(mask, pending.spares.clone())))
        })?;
        if !matches!(answer, Err(Error::Timeout { .. })) {
            drop(pending.remove()?);
        }
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(mask, pm_mask::new(answer?)?) }
    })
}

/// Drops a frame that is under way: nobody wants its pairs.
#[unsafe(no_mangle)]
pub extern "C" fn pm_pending_drop(pending: pm_pending) -> pm_code {
    pending.drop()
}

/// Drops a mask, and what was decoded of it.
#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_drop(mask: pm_mask) -> pm_code {
    mask.drop()
}

/// How many pairs there are.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_count(mask: pm_mask, count: *mut u64) -> pm_code {
    call(|| {
        let found = mask.with(|mask| Ok(mask.mask.count()))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(count, found) }
    })
}

/// Whether two boxes are a pair.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_contains(
    mask: pm_mask,
    a: u32,
    b: u32,
    contains: *mut bool,
) -> pm_code {
    call(|| {
        let found = mask.with(|mask| Ok(mask.mask.contains(a, b)))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(contains, found) }
    })
}

/// All pairs as an array, which lives until the mask is dropped. A list in this process's memory is given where
/// it lies; else the pairs are decoded once, into memory that the session uses again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_pairs(
    mask: pm_mask,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || {
            mask.with(|mask| {
                let Mask { mask, decoded } = mask;
                let found = match mask.own_list() {
                    Some(list) => list,
                    None => decoded.get(|out| {
                        mask.for_each_slice(|pairs| out.extend_from_slice(pairs));
                    }),
                };
                Ok((to_pairs(found).as_ptr(), found.len()))
            })
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(pairs, count, find) }
    })
}

/// Calls `visit` with pairs, some at a time, until all were seen: the fastest way through a mask, without a copy
/// of it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_for_each(
    mask: pm_mask,
    visit: pm_visit,
    user: *mut c_void,
) -> pm_code {
    call(|| {
        let visit = visitor(visit)?;
        mask.with(|mask| {
            mask.mask.for_each_slice(|pairs| {
                // SAFETY: the callback is the caller's, who gives what it needs in `user`.
                unsafe { visit(user, to_pairs(pairs).as_ptr(), pairs.len()) };
            });
            Ok(())
        })
    })
}

/// Called with some words of a mask at a time.
pub type pm_visit_words =
    Option<unsafe extern "C" fn(user: *mut c_void, words: *const pm_word, count: usize)>;

/// Words that a callback gets at a time: 6 KiB stay in a core's nearest cache.
const WORDS: usize = 256;

/// Calls `visit` with the words of a mask that are not zero, some at a time: for AND masks of the caller's own.
/// Each pair of a mask that is a list is a word of one bit.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_for_each_word(
    mask: pm_mask,
    visit: pm_visit_words,
    user: *mut c_void,
) -> pm_code {
    call(|| {
        let visit = visit.ok_or(Failure::argument("the callback is null"))?;
        mask.with(|mask| {
            let mut some = Vec::with_capacity(WORDS);
            let flush = |some: &mut Vec<pm_word>| {
                // SAFETY: the callback is the caller's, who gives what it needs in `user`.
                unsafe { visit(user, some.as_ptr(), some.len()) };
                some.clear();
            };
            for word in mask.mask.words() {
                some.push(word.into());
                if some.len() == WORDS {
                    flush(&mut some);
                }
            }
            if !some.is_empty() {
                flush(&mut some);
            }
            Ok(())
        })
    })
}

/// The box index at each position of a mask with sparse words, as an array that lives until the mask is dropped.
/// Null where a position is an index: every mask that is not sparse, and some that are.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_order(
    mask: pm_mask,
    order: *mut *const u32,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || {
            mask.with(|mask| {
                // Asked first: the compiler may read what other views leave unset, which valgrind would tell.
                if mask.mask.encoding() != Encoding::Sparse {
                    return Ok((null(), 0));
                }
                let MaskView::Sparse(sparse) = mask.mask.view() else { return Ok((null(), 0)) };
                Ok(sparse.order().map_or((null(), 0), |order| (order.as_ptr(), order.len())))
            })
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(order, count, find) }
    })
}

/// The pairs of one world, as an array that lives until the mask is dropped; none where the world has none. Only
/// masks of frames whose rules have worlds know them; `PM_ERR_STATE` from others.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_pairs_of_world(
    mask: pm_mask,
    world: i32,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || {
            mask.with(|mask| {
                if mask.mask.worlds().is_empty() {
                    let text =
                        "the mask is not ordered by world: ask for a list of a frame with worlds";
                    return Err(Failure::new(crate::code::PM_ERR_STATE, text));
                }
                let found = mask.mask.pairs_of_world(World(world));
                Ok(found.map_or((null(), 0), |found| (to_pairs(found).as_ptr(), found.len())))
            })
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(pairs, count, find) }
    })
}

/// Facts about the frame beside its pairs. Set `info->struct_size` first.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_mask_info(mask: pm_mask, info: *mut pm_frame_info) -> pm_code {
    call(|| {
        check_out(info)?;
        let facts = mask.with(|mask| Ok(pm_frame_info::of(&mask.mask)))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_growing(info, &facts) }
    })
}
