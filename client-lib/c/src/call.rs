//! What every function does around its work: no panic crosses, and errors leave their text.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::code::pm_code::{self, PM_ERR_PANIC, PM_OK};
use crate::failure::Failure;

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Does the work of a function.
pub fn call(work: impl FnOnce() -> Result<(), Failure>) -> pm_code {
    let bug =
        "pairmask panicked, which is a bug of it: its message is on the standard error output";
    // What a panic leaves half done is behind a lock that is poisoned then, or was removed from the table.
    let done = catch_unwind(AssertUnwindSafe(work));
    let Err(Failure { code, text }) = done.unwrap_or(Err(Failure::new(PM_ERR_PANIC, bug))) else {
        return PM_OK;
    };
    // A zero would end the text early.
    let text = CString::new(format!("{code:?}: {text}").replace('\0', " ")).unwrap_or_default();
    // A thread that ends has none any more.
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = text);
    code
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_last_error() -> *const c_char {
    LAST_ERROR.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
