//! Sessions with a margin: `pm_margined`.
#![allow(unsafe_code)]

use bytemuck::{Pod, Zeroable};
use pairmask::Margin;

use crate::call::call;
use crate::code::pm_code;
use crate::frame::{pm_precision, precision_of};
use crate::handles::handle;
use crate::memory::{array, check_out, value, write, write_growing};
use crate::session::pm_session;
use crate::values::{boxes as as_boxes, pm_box, pm_pair, to_pairs};

/// A session that asks only when a box has moved by more than a margin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_margined {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_margined` names.
pub struct Margined {
    margined: pairmask::Margined,
    pairs: Vec<[u32; 2]>,
}

handle!(pm_margined is Box<Margined>);

/// Makes one of a session, whose handle names nothing any more. `precision` may be null, for exact boxes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_margined_create(
    session: pm_session,
    margin: f32,
    precision: *const pm_precision,
    margined: *mut pm_margined,
) -> pm_code {
    call(|| {
        check_out(margined)?;
        let margin = Margin::new(margin)?;
        let mut form = pm_precision::default();
        if !precision.is_null() {
            // SAFETY: the caller's promise about pointers is passed on.
            form = unsafe { value(precision) }?;
        }
        let precision = precision_of(&form)?;
        let session = session.remove()?.session;
        let made = pairmask::Margined::new(session, margin).with_precision(precision);
        let made = Margined { margined: made, pairs: Vec::new() };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(margined, pm_margined::new(Box::new(made))?) }
    })
}

/// The pairs that overlap among some boxes, as an array that lives until the next call with this handle. Where
/// `near` is set, pairs that are near are among them, and none of them is tested again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_margined_cull(
    margined: pm_margined,
    boxes: *const pm_box,
    n: usize,
    near: bool,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    call(|| {
        check_out(pairs)?;
        check_out(count)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let boxes = as_boxes(unsafe { array(boxes, n) }?);
        let (memory, len) = margined.with(|margined| {
            let Margined { margined, pairs } = &mut **margined;
            pairs.clear();
            let kept = margined.cull(boxes)?;
            if near {
                kept.mask().for_each_slice(|some| pairs.extend_from_slice(some));
            } else {
                pairs.extend(kept.exact_pairs().map(|(a, b)| [a, b]));
            }
            Ok((to_pairs(pairs).as_ptr(), pairs.len()))
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            write(pairs, memory)?;
            write(count, len)
        }
    })
}

/// Requests made and saved so far.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_margin_stats {
    /// `sizeof(pm_margin_stats)`, set by the caller.
    pub struct_size: usize,
    /// Frames for which a request was made.
    pub requests: u64,
    /// Frames that the last answer served.
    pub skipped: u64,
}

/// Requests made and saved so far. Set `stats->struct_size` first.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_margined_stats(
    margined: pm_margined,
    stats: *mut pm_margin_stats,
) -> pm_code {
    call(|| {
        let told = margined.with(|margined| Ok(margined.margined.stats()))?;
        let facts =
            pm_margin_stats { struct_size: 0, requests: told.requests, skipped: told.skipped };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_growing(stats, &facts) }
    })
}

/// Discards the kept answer, so that the next frame makes a request.
#[unsafe(no_mangle)]
pub extern "C" fn pm_margined_forget(margined: pm_margined) -> pm_code {
    call(|| {
        margined.with(|margined| {
            margined.margined.forget();
            Ok(())
        })
    })
}

/// Drops it, and its session.
#[unsafe(no_mangle)]
pub extern "C" fn pm_margined_drop(margined: pm_margined) -> pm_code {
    margined.drop()
}
