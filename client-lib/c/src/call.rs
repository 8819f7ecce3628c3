//! What every function does around its work: no panic crosses, and errors leave their text.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::code::{PM_ERR_PANIC, PM_OK, pm_code};
use crate::failure::Failure;

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Does the work of a function.
pub fn call(work: impl FnOnce() -> Result<(), Failure>) -> pm_code {
    // What a panic leaves half done is behind a lock that is poisoned then, or was taken from the table.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => PM_OK,
        Ok(Err(failure)) => {
            keep(&failure.text);
            failure.code
        }
        Err(_) => {
            keep(
                "pairmask panicked, which is a bug of it: its message is on the standard error output",
            );
            PM_ERR_PANIC
        }
    }
}

fn keep(text: &str) {
    // A zero would end the text early.
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    // A thread that ends has no place for it any more.
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = text);
}

/// What was wrong with the last call of this thread that failed, in words; empty where none did. The text
/// lives until another call of this thread fails.
#[allow(unsafe_code)] // The name is one of the header's.
#[unsafe(no_mangle)]
pub extern "C" fn pm_last_error() -> *const c_char {
    LAST_ERROR.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
