//! The codes that functions return, and their names.

use std::ffi::{CStr, c_char};

/// What a function returns: `PM_OK`, or why it did nothing. Numbers do not change; later versions may add
/// some.
pub type pm_code = i32;

/// Done.
pub const PM_OK: pm_code = 0;
/// An argument is wrong: a null pointer, a number that stands for nothing, a text that is no UTF-8.
pub const PM_ERR_ARGUMENT: pm_code = 1;
/// The handle is zero, was dropped, or is of another kind.
pub const PM_ERR_HANDLE: pm_code = 2;
/// Another call uses the handle: of another thread, or the one whose callback this is.
pub const PM_ERR_BUSY: pm_code = 3;
/// The object cannot do that: spheres of a frame of boxes, a lease of a scene that is not shared, an answer
/// of a scene that has none.
pub const PM_ERR_STATE: pm_code = 4;
/// A bug of this library. The objects of the call cannot be used any more.
pub const PM_ERR_PANIC: pm_code = 5;
/// More live handles than there are ids.
pub const PM_ERR_TOO_MANY_HANDLES: pm_code = 6;

/// No daemon serves the instance.
pub const PM_ERR_NO_DAEMON: pm_code = 10;
/// This library was built without the transport.
pub const PM_ERR_NOT_BUILT_IN: pm_code = 11;
/// The daemon lives and did not answer in time.
pub const PM_ERR_SILENT: pm_code = 12;
/// The instance is another user's.
pub const PM_ERR_OTHER_USER: pm_code = 13;
/// The daemon speaks another major version of the wire contract.
pub const PM_ERR_VERSION_MISMATCH: pm_code = 14;
/// The daemon has no slot for another client.
pub const PM_ERR_TOO_MANY_CLIENTS: pm_code = 15;
/// No shared memory is left.
pub const PM_ERR_OUT_OF_SHARED_MEMORY: pm_code = 16;
/// The instruction set is unknown, or this machine does not have it.
pub const PM_ERR_ISA: pm_code = 17;
/// No name of an instance, or its directory cannot be used.
pub const PM_ERR_INSTANCE: pm_code = 18;
/// The transport failed.
pub const PM_ERR_TRANSPORT: pm_code = 19;

/// More boxes or spheres than an index can name.
pub const PM_ERR_TOO_MANY_BOXES: pm_code = 30;
/// The lists of a frame's rules are too long to be sent.
pub const PM_ERR_TOO_MANY_LISTED_PAIRS: pm_code = 32;
/// The first of two sets has more boxes than the frame.
pub const PM_ERR_FIRST_SET: pm_code = 33;
/// Three frames are being filled, under way or held as masks.
pub const PM_ERR_TOO_MANY_FRAMES: pm_code = 34;
/// The engine failed, or the one asked for is not here.
pub const PM_ERR_CULL: pm_code = 35;

/// No answer yet. What was waited for is still under way.
pub const PM_ERR_TIMEOUT: pm_code = 50;
/// The daemon died before it answered.
pub const PM_ERR_DAEMON_DIED: pm_code = 51;
/// The daemon answered with an error, or with something that is malformed.
pub const PM_ERR_REPLY: pm_code = 52;
/// The answer was taken before.
pub const PM_ERR_TAKEN: pm_code = 53;

/// An index beyond what the scene may hold.
pub const PM_ERR_BEYOND_LIMIT: pm_code = 70;
/// Not one box, or tag, for each index.
pub const PM_ERR_LENGTHS: pm_code = 71;
/// Not one margin for each box, nor one for all; or a margin that is negative or not finite.
pub const PM_ERR_MARGINS: pm_code = 72;
/// An index is set twice in one edit.
pub const PM_ERR_SET_TWICE: pm_code = 73;
/// An index has no box.
pub const PM_ERR_ABSENT: pm_code = 74;
/// A box with a margin in a scene whose boxes have none.
pub const PM_ERR_NO_MARGINS: pm_code = 75;
/// No memory of this process is left.
pub const PM_ERR_OUT_OF_MEMORY: pm_code = 76;
/// More queries and indices than a mask has objects.
pub const PM_ERR_TOO_MANY_QUERIES: pm_code = 77;
/// Not one tag for each query, nor one for all.
pub const PM_ERR_QUERY_TAGS: pm_code = 78;
/// More than 65,536 filters.
pub const PM_ERR_TOO_MANY_FILTERS: pm_code = 79;
/// Bounds that are empty or not finite.
pub const PM_ERR_BOUNDS: pm_code = 80;

/// No name of a shared scene.
pub const PM_ERR_SCENE_NAME: pm_code = 90;
/// The session answers in process, where there is no shared scene.
pub const PM_ERR_IN_PROCESS: pm_code = 91;
/// The shared scene has other terms.
pub const PM_ERR_TERMS_DIFFER: pm_code = 93;
/// The lease is refused.
pub const PM_ERR_LEASE: pm_code = 94;
/// The edit names what is not leased.
pub const PM_ERR_NOT_LEASED: pm_code = 95;

/// An error of a later version of the library's parts, which this one has no code for.
pub const PM_ERR_OTHER: pm_code = 99;

/// Every code with its name.
const NAMES: [(pm_code, &CStr); 43] = [
    (PM_OK, c"PM_OK"),
    (PM_ERR_ARGUMENT, c"PM_ERR_ARGUMENT"),
    (PM_ERR_HANDLE, c"PM_ERR_HANDLE"),
    (PM_ERR_BUSY, c"PM_ERR_BUSY"),
    (PM_ERR_STATE, c"PM_ERR_STATE"),
    (PM_ERR_PANIC, c"PM_ERR_PANIC"),
    (PM_ERR_TOO_MANY_HANDLES, c"PM_ERR_TOO_MANY_HANDLES"),
    (PM_ERR_NO_DAEMON, c"PM_ERR_NO_DAEMON"),
    (PM_ERR_NOT_BUILT_IN, c"PM_ERR_NOT_BUILT_IN"),
    (PM_ERR_SILENT, c"PM_ERR_SILENT"),
    (PM_ERR_OTHER_USER, c"PM_ERR_OTHER_USER"),
    (PM_ERR_VERSION_MISMATCH, c"PM_ERR_VERSION_MISMATCH"),
    (PM_ERR_TOO_MANY_CLIENTS, c"PM_ERR_TOO_MANY_CLIENTS"),
    (PM_ERR_OUT_OF_SHARED_MEMORY, c"PM_ERR_OUT_OF_SHARED_MEMORY"),
    (PM_ERR_ISA, c"PM_ERR_ISA"),
    (PM_ERR_INSTANCE, c"PM_ERR_INSTANCE"),
    (PM_ERR_TRANSPORT, c"PM_ERR_TRANSPORT"),
    (PM_ERR_TOO_MANY_BOXES, c"PM_ERR_TOO_MANY_BOXES"),
    (PM_ERR_TOO_MANY_LISTED_PAIRS, c"PM_ERR_TOO_MANY_LISTED_PAIRS"),
    (PM_ERR_FIRST_SET, c"PM_ERR_FIRST_SET"),
    (PM_ERR_TOO_MANY_FRAMES, c"PM_ERR_TOO_MANY_FRAMES"),
    (PM_ERR_CULL, c"PM_ERR_CULL"),
    (PM_ERR_TIMEOUT, c"PM_ERR_TIMEOUT"),
    (PM_ERR_DAEMON_DIED, c"PM_ERR_DAEMON_DIED"),
    (PM_ERR_REPLY, c"PM_ERR_REPLY"),
    (PM_ERR_TAKEN, c"PM_ERR_TAKEN"),
    (PM_ERR_BEYOND_LIMIT, c"PM_ERR_BEYOND_LIMIT"),
    (PM_ERR_LENGTHS, c"PM_ERR_LENGTHS"),
    (PM_ERR_MARGINS, c"PM_ERR_MARGINS"),
    (PM_ERR_SET_TWICE, c"PM_ERR_SET_TWICE"),
    (PM_ERR_ABSENT, c"PM_ERR_ABSENT"),
    (PM_ERR_NO_MARGINS, c"PM_ERR_NO_MARGINS"),
    (PM_ERR_OUT_OF_MEMORY, c"PM_ERR_OUT_OF_MEMORY"),
    (PM_ERR_TOO_MANY_QUERIES, c"PM_ERR_TOO_MANY_QUERIES"),
    (PM_ERR_QUERY_TAGS, c"PM_ERR_QUERY_TAGS"),
    (PM_ERR_TOO_MANY_FILTERS, c"PM_ERR_TOO_MANY_FILTERS"),
    (PM_ERR_BOUNDS, c"PM_ERR_BOUNDS"),
    (PM_ERR_SCENE_NAME, c"PM_ERR_SCENE_NAME"),
    (PM_ERR_IN_PROCESS, c"PM_ERR_IN_PROCESS"),
    (PM_ERR_TERMS_DIFFER, c"PM_ERR_TERMS_DIFFER"),
    (PM_ERR_LEASE, c"PM_ERR_LEASE"),
    (PM_ERR_NOT_LEASED, c"PM_ERR_NOT_LEASED"),
    (PM_ERR_OTHER, c"PM_ERR_OTHER"),
];

/// The name of a code, `"PM_OK"` for one, or `"unknown code"`. The text lives as long as the process.
#[allow(unsafe_code)] // The name is one of the header's.
#[unsafe(no_mangle)]
pub extern "C" fn pm_code_name(code: pm_code) -> *const c_char {
    NAMES.iter().find(|(c, _)| *c == code).map_or(c"unknown code", |(_, name)| name).as_ptr()
}
