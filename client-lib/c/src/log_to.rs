//! The library's log, handed to the program.
#![allow(unsafe_code)]

use std::ffi::{CString, c_char, c_void};
use std::sync::OnceLock;

use log::{Level, LevelFilter, Log, Metadata, Record};

use crate::call::call;
use crate::code::pm_code::{self, PM_ERR_STATE};
use crate::failure::Failure;

pub type pm_log_level = u32;
pub const PM_LOG_ERROR: pm_log_level = 1;
pub const PM_LOG_WARNING: pm_log_level = 2;
pub const PM_LOG_INFO: pm_log_level = 3;

pub type pm_log =
    Option<unsafe extern "C" fn(user: *mut c_void, level: pm_log_level, text: *const c_char)>;

/// The program's callback.
struct Program {
    log: unsafe extern "C" fn(*mut c_void, pm_log_level, *const c_char),
    user: *mut c_void,
}

// SAFETY: the header documents that the callback is called from any thread; `user` is handed to it alone.
unsafe impl Send for Program {}
// SAFETY: as above: several threads at once too.
unsafe impl Sync for Program {}

impl Log for Program {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= Level::Info && metadata.target().starts_with("pairmask")
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let level = match record.level() {
            Level::Error => PM_LOG_ERROR,
            Level::Warn => PM_LOG_WARNING,
            _ => PM_LOG_INFO,
        };
        let text = CString::new(record.args().to_string().replace('\0', " ")).unwrap_or_default();
        // SAFETY: the callback is the program's, with what it gave for it.
        unsafe { (self.log)(self.user, level, text.as_ptr()) };
    }

    fn flush(&self) {}
}

static PROGRAM: OnceLock<Program> = OnceLock::new();

#[unsafe(no_mangle)]
pub extern "C" fn pm_set_log(log: pm_log, user: *mut c_void) -> pm_code {
    call(|| {
        let log = log.ok_or(Failure::argument("the callback is null"))?;
        let again = || Failure::new(PM_ERR_STATE, "the log was set before");
        PROGRAM.set(Program { log, user }).map_err(|_| again())?;
        let program = PROGRAM.get().ok_or_else(again)?;
        log::set_logger(program).map_err(|_| again())?;
        log::set_max_level(LevelFilter::Info);
        Ok(())
    })
}
