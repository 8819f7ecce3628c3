//! Answers of queries: `pm_found`.
#![allow(unsafe_code)]

use std::ffi::c_void;

use pairmask::QueryAnswer;

use crate::call::call;
use crate::code::pm_code;
use crate::handles::handle;
use crate::mask::{pm_visit, visitor};
use crate::memory::write_list;
use crate::spares::Decoded;
use crate::values::{pm_pair, to_pairs};

/// The boxes of a scene that some other boxes overlap: pairs of a query's number and an index, by query and then
/// by index. An answer of a daemon holds one of the session's three places until it is dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_found {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_found` names.
pub struct Found {
    pub answer: QueryAnswer,
    pub decoded: Decoded,
}

handle!(pm_found is Found);

/// All that was found, as an array that lives until the answer is dropped: `a` is the query, `b` the index.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_found_pairs(
    found: pm_found,
    pairs: *mut *const pm_pair,
    count: *mut usize,
) -> pm_code {
    call(|| {
        let find = || {
            found.with(|found| {
                let Found { answer, decoded } = found;
                let all = decoded.get(|out| {
                    answer.for_each_slice(|pairs| out.extend_from_slice(pairs));
                });
                Ok((to_pairs(all).as_ptr(), all.len()))
            })
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_list(pairs, count, find) }
    })
}

/// Calls `visit` with what was found, some at a time: `a` is the query, `b` the index.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_found_for_each(
    found: pm_found,
    visit: pm_visit,
    user: *mut c_void,
) -> pm_code {
    call(|| {
        let visit = visitor(visit)?;
        found.with(|found| {
            found.answer.for_each_slice(|pairs| {
                // SAFETY: the callback is the caller's, who gives what it needs in `user`.
                unsafe { visit(user, to_pairs(pairs).as_ptr(), pairs.len()) };
            });
            Ok(())
        })
    })
}

/// Drops an answer.
#[unsafe(no_mangle)]
pub extern "C" fn pm_found_drop(found: pm_found) -> pm_code {
    found.drop()
}
