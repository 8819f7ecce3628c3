//! Frames under way and their answers: `pm_pending`, `pm_mask`.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::c_void;
use std::ptr::null;
use std::time::Duration;

use pairmask::filters::World;
use pairmask::{Error, PairMask};
use pairmask_core::mask::{AddressedWord, Encoding, MaskView, WordAddress};

use crate::call::call;
use crate::code::pm_code::{self, PM_ERR_STATE};
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{Out, raw};
use crate::values::{name_of, pm_name, pm_pair, pm_served_by, served_by_number, to_pairs};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_pending {
    pub id: u64,
}

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_mask {
    pub id: u64,
}

/// What a `pm_mask` names.
pub struct Mask {
    answer: PairMask,
    /// Once they are asked for.
    decoded: Option<Vec<[u32; 2]>>,
}

/// Masks that a session holds at a time, at the most.
const MOST_SPARES: usize = 3;

thread_local! {
    /// Memory of decoded pairs for the next masks of this thread: fresh pages cost more than the pairs that are
    /// written into them.
    static SPARES: RefCell<Vec<Vec<[u32; 2]>>> = const { RefCell::new(Vec::new()) };
}

/// Frees the memory that this thread has for the next masks.
pub fn free_spares() {
    SPARES.take();
}

impl Mask {
    pub const fn new(answer: PairMask) -> Self {
        Self { answer, decoded: None }
    }

    fn pairs(&mut self) -> &[[u32; 2]] {
        let Self { answer, decoded } = self;
        let decode = || {
            let mut pairs = SPARES.with_borrow_mut(Vec::pop).unwrap_or_default();
            answer.for_each_slice(|some| pairs.extend_from_slice(some));
            pairs
        };
        answer.own_list().unwrap_or_else(|| decoded.get_or_insert_with(decode))
    }
}

impl Drop for Mask {
    fn drop(&mut self) {
        let Some(mut pairs) = self.decoded.take() else { return };
        pairs.clear();
        // A thread that ends has none any more.
        let _ = SPARES.try_with(|spares| {
            let mut spares = spares.borrow_mut();
            if spares.len() < MOST_SPARES {
                spares.push(pairs);
            }
        });
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_pending_wait(pending: pm_pending, mask: Out<pm_mask>) -> pm_code {
    call(|| {
        let pending = pending.remove()?;
        mask.check()?;
        mask.write(pm_mask::new(Mask::new(pending.wait()?))?)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_pending_wait_timeout(
    pending: pm_pending,
    timeout_ns: u64,
    mask: Out<pm_mask>,
) -> pm_code {
    mask.give(|| {
        let timeout = Duration::from_nanos(timeout_ns);
        let answer = pending.with(|pending| Ok(pending.wait_timeout(timeout)))?;
        if !matches!(answer, Err(Error::Timeout { .. })) {
            drop(pending.remove()?);
        }
        pm_mask::new(Mask::new(answer?))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_pending_drop(pending: pm_pending) -> pm_code {
    pending.drop()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_drop(mask: pm_mask) -> pm_code {
    mask.drop()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_contains(mask: pm_mask, a: u32, b: u32, contains: Out<bool>) -> pm_code {
    contains.give(|| mask.with(|mask| Ok(mask.answer.contains(a, b))))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_pairs(
    mask: pm_mask,
    pairs: Out<*const pm_pair>,
    count: Out<usize>,
) -> pm_code {
    pairs.give_list(count, || mask.with(|mask| Ok(raw(to_pairs(mask.pairs())))))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_pairs_of_world(
    mask: pm_mask,
    world: i32,
    pairs: Out<*const pm_pair>,
    count: Out<usize>,
) -> pm_code {
    pairs.give_list(count, || {
        mask.with(|mask| {
            if mask.answer.worlds().is_empty() {
                let text =
                    "the mask is not ordered by world: ask for a list of a frame with worlds";
                return Err(Failure::new(PM_ERR_STATE, text));
            }
            let found = mask.answer.pairs_of_world(World(world));
            Ok(found.map_or((null(), 0), |found| raw(to_pairs(found))))
        })
    })
}

/// A callback that gets some values at a time.
type ForEach<T> = unsafe extern "C" fn(user: *mut c_void, values: *const T, count: usize);

pub type pm_pair_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, pairs: *const pm_pair, count: usize)>;

pub type pm_word_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, words: *const pm_word, count: usize)>;

/// Calls a program's callback with what `hand_out` hands out of a mask.
fn iterate<T>(
    mask: pm_mask,
    callback: Option<ForEach<T>>,
    user: *mut c_void,
    hand_out: impl FnOnce(&PairMask, &mut dyn FnMut(&[T])),
) -> pm_code {
    call(|| {
        let callback = callback.ok_or(Failure::argument("the callback is null"))?;
        mask.with(|mask| {
            hand_out(&mask.answer, &mut |some| {
                // SAFETY: the callback is the program's, which gives what it needs in `user`.
                unsafe { callback(user, some.as_ptr(), some.len()) };
            });
            Ok(())
        })
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_for_each(
    mask: pm_mask,
    callback: pm_pair_callback,
    user: *mut c_void,
) -> pm_code {
    iterate(mask, callback, user, |mask, iterate| {
        mask.for_each_slice(|some| iterate(to_pairs(some)));
    })
}

#[derive(Clone, Copy)]
#[repr(C)]
pub struct pm_word {
    pub first: u64,
    pub row: u32,
    pub block: u32,
    pub bits: u32,
}

impl From<AddressedWord> for pm_word {
    fn from(word: AddressedWord) -> Self {
        let (first, row, block) = match word.address {
            WordAddress::Dense { first } => (first.get(), 0, 0),
            WordAddress::Sparse { row, block } => (0, row, block),
        };
        Self { first, row, block, bits: word.bits.0 }
    }
}

/// Words that a callback gets at a time: 6 KiB stay in a core's nearest cache.
const WORDS: usize = 256;

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_for_each_word(
    mask: pm_mask,
    callback: pm_word_callback,
    user: *mut c_void,
) -> pm_code {
    iterate(mask, callback, user, |mask, iterate| {
        let (mut words, mut some) = (mask.words().map(pm_word::from), Vec::with_capacity(WORDS));
        loop {
            some.extend(words.by_ref().take(WORDS));
            if some.is_empty() {
                break;
            }
            iterate(&some);
            some.clear();
        }
    })
}

pub type pm_encoding = u32;
pub const PM_ENCODING_DENSE: pm_encoding = 0;
pub const PM_ENCODING_SPARSE: pm_encoding = 1;
pub const PM_ENCODING_LIST: pm_encoding = 2;

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_frame_info {
    pub struct_size: usize,
    pub served_by: pm_served_by,
    pub encoding: pm_encoding,
    pub n: u32,
    pub threads: u32,
    pub empty: u32,
    pub invalid: u32,
    pub is_repeat: u32,
    pub pair_count: u64,
    pub skipped_pairs: u64,
    pub mask_bytes: u64,
    pub box_bytes: u64,
    pub total_ns: u64,
    pub execute_ns: u64,
    pub engine: pm_name,
    pub order: *const u32,
    pub order_count: usize,
}

growing!(pm_frame_info);

/// Where the order of a sparse mask lies.
fn order_of(mask: &PairMask) -> (*const u32, usize) {
    // The encoding first: the compiler may read what other views leave unset, which valgrind would report.
    if mask.encoding() == Encoding::Sparse
        && let MaskView::Sparse(sparse) = mask.view()
        && let Some(order) = sparse.order()
    {
        return raw(order);
    }
    (null(), 0)
}

fn info_of(mask: &PairMask) -> pm_frame_info {
    let info = mask.info();
    let (order, order_count) = order_of(mask);
    pm_frame_info {
        served_by: served_by_number(info.served_by),
        encoding: match mask.encoding() {
            Encoding::Dense => PM_ENCODING_DENSE,
            Encoding::Sparse => PM_ENCODING_SPARSE,
            // A later encoding would be decoded to pairs as well.
            _ => PM_ENCODING_LIST,
        },
        n: mask.n().get(),
        threads: u32::try_from(info.threads).unwrap_or(u32::MAX),
        empty: info.census.empty,
        invalid: info.census.invalid,
        is_repeat: u32::from(info.skipped.is_repeat()),
        pair_count: mask.count(),
        skipped_pairs: info.skipped.pairs,
        mask_bytes: info.mask_bytes,
        box_bytes: info.box_bytes,
        total_ns: info.times.total_ns,
        execute_ns: info.times.execute_ns,
        engine: name_of(info.engine),
        order,
        order_count,
        ..Default::default()
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_mask_info(mask: pm_mask, info: Out<pm_frame_info>) -> pm_code {
    info.give_growing(|| mask.with(|mask| Ok(info_of(&mask.answer))))
}
