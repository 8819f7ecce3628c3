//! The codes that functions return, and which version of the library this is.
#![allow(unsafe_code)]

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub enum pm_code {
    PM_OK = 0,
    PM_ERR_ARGUMENT = 1,
    PM_ERR_HANDLE = 2,
    PM_ERR_BUSY = 3,
    PM_ERR_STATE = 4,
    PM_ERR_PANIC = 5,
    PM_ERR_TOO_MANY_HANDLES = 6,
    PM_ERR_NO_DAEMON = 10,
    PM_ERR_NOT_BUILT_IN = 11,
    PM_ERR_SILENT = 12,
    PM_ERR_OTHER_USER = 13,
    PM_ERR_VERSION_MISMATCH = 14,
    PM_ERR_TOO_MANY_CLIENTS = 15,
    PM_ERR_OUT_OF_SHARED_MEMORY = 16,
    PM_ERR_ISA = 17,
    PM_ERR_INSTANCE = 18,
    PM_ERR_TRANSPORT = 19,
    PM_ERR_TOO_MANY_BOXES = 30,
    PM_ERR_TOO_MANY_LISTED_PAIRS = 32,
    PM_ERR_FIRST_SET = 33,
    PM_ERR_TOO_MANY_FRAMES = 34,
    PM_ERR_CULL = 35,
    PM_ERR_TIMEOUT = 50,
    PM_ERR_DAEMON_DIED = 51,
    PM_ERR_REPLY = 52,
    PM_ERR_ALREADY_RECEIVED = 53,
    PM_ERR_BEYOND_LIMIT = 70,
    PM_ERR_LENGTHS = 71,
    PM_ERR_MARGINS = 72,
    PM_ERR_SET_TWICE = 73,
    PM_ERR_ABSENT = 74,
    PM_ERR_NO_MARGINS = 75,
    PM_ERR_OUT_OF_MEMORY = 76,
    PM_ERR_TOO_MANY_QUERIES = 77,
    PM_ERR_QUERY_FILTER_DATA = 78,
    PM_ERR_TOO_MANY_FILTERS = 79,
    PM_ERR_BOUNDS = 80,
    PM_ERR_INEXACT_SHIFT = 81,
    PM_ERR_SCENE_FILE = 82,
    PM_ERR_SNAPSHOT = 83,
    PM_ERR_SCENE_NAME = 90,
    PM_ERR_IN_PROCESS = 91,
    PM_ERR_TERMS_DIFFER = 93,
    PM_ERR_LEASE = 94,
    PM_ERR_NOT_LEASED = 95,
    PM_ERR_OTHER = 99,
}

pub const PM_VERSION: u32 = 0x00_01_00;

#[unsafe(no_mangle)]
pub extern "C" fn pm_version() -> u32 {
    PM_VERSION
}

#[test]
fn the_version_is_the_crates() {
    let of = |part: &str| part.parse::<u32>().expect("a number");
    let crates = of(env!("CARGO_PKG_VERSION_MAJOR")) << 16
        | of(env!("CARGO_PKG_VERSION_MINOR")) << 8
        | of(env!("CARGO_PKG_VERSION_PATCH"));
    assert_eq!(pm_version(), crates);
}
