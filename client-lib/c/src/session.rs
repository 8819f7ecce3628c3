//! Sessions: `pm_session`.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::ptr::null;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use pairmask::{Backend, ServedBy};
use pairmask_core::units::BoxCount;

use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::handle;
use crate::memory::{Growing, check_out, growing, text, write, write_growing};
use crate::spares::Spares;

/// A client's connection to a daemon or to the engines of this process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_session {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_session` names.
pub struct Session {
    pub session: pairmask::Session,
    pub spares: Spares,
}

handle!(pm_session is Session);

/// Where pairs are found: one of `PM_BACKEND_...`. The pairs are the same.
pub type pm_backend = u32;
/// The daemon where one answers, else in process. The session returns to the daemon by itself.
pub const PM_BACKEND_AUTO: pm_backend = 0;
/// The daemon, or an error.
pub const PM_BACKEND_DAEMON: pm_backend = 1;
/// The CPU engines of this library.
pub const PM_BACKEND_IN_PROCESS: pm_backend = 2;

/// What answered: one of `PM_SERVED_BY_...`.
pub type pm_served_by = u32;
/// The daemon, through shared memory.
pub const PM_SERVED_BY_DAEMON: pm_served_by = 1;
/// This process.
pub const PM_SERVED_BY_THIS_PROCESS: pm_served_by = 2;

/// Settings of a session. Zeros mean that the library chooses. Texts are read by `pm_session_connect` alone.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_session_options {
    /// `sizeof(pm_session_options)`.
    pub struct_size: usize,
    /// Name of the daemon's instance; null for `default`.
    pub instance: *const c_char,
    /// Directory where instances live; null for `$PAIRMASK_RUNTIME_DIR` and what stands in for it.
    pub runtime_dir: *const c_char,
    /// One engine and no other, by a name that `pairmaskd cull --help` lists at `--engine`; null for the plan's
    /// choice.
    pub engine: *const c_char,
    /// One encoding and no other: `dense`, `sparse` or `list`; null for the plan's choice.
    pub encoding: *const c_char,
    /// Instruction set of this process's engines and decoders; null for `$PAIRMASK_ISA`, else the widest.
    pub isa: *const c_char,
    /// `PM_BACKEND_...`.
    pub backend: pm_backend,
    /// Threads that an engine may use.
    pub threads: u32,
    /// Threads with which pairs are visited.
    pub visit_threads: u32,
    /// Boxes that the first segment should hold.
    pub capacity: u32,
    /// How long to spin for an answer beyond its expected time, ns; `UINT64_MAX` for never.
    pub spin_ns: u64,
    /// How long a wait waits, ns; 5 s unless set.
    pub deadline_ns: u64,
    /// 1 where a frame that is equal to the last one is culled anew: for measurements.
    pub no_repeats: u32,
    /// Zero.
    pub reserved: u32,
}

impl Default for pm_session_options {
    fn default() -> Self {
        Self {
            struct_size: size_of::<Self>(),
            instance: null(),
            runtime_dir: null(),
            engine: null(),
            encoding: null(),
            isa: null(),
            backend: PM_BACKEND_AUTO,
            threads: 0,
            visit_threads: 0,
            capacity: 0,
            spin_ns: 0,
            deadline_ns: 0,
            no_repeats: 0,
            reserved: 0,
        }
    }
}

// SAFETY: it is `repr(C)` and begins with its size; pointers and integers have no invalid bit patterns.
unsafe impl Growing for pm_session_options {}

/// Makes a session. `options` may be null. With `PM_BACKEND_AUTO` a missing daemon is no error.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_connect(
    options: *const pm_session_options,
    session: *mut pm_session,
) -> pm_code {
    call(|| {
        check_out(session)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let options = unsafe { growing(options, pm_session_options::default()) }?;
        // SAFETY: the caller's promise about the texts of the options is passed on.
        let made = unsafe { connect(&options) }?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(session, pm_session::new(made)?) }
    })
}

/// # Safety
/// The texts are null, or valid up to a zero.
unsafe fn connect(options: &pm_session_options) -> Result<Session, Failure> {
    // SAFETY: the caller's promise is passed on.
    let read = |pointer| unsafe { text(pointer) };
    let mut builder = pairmask::Session::builder().backend(match options.backend {
        PM_BACKEND_AUTO => Backend::Auto,
        PM_BACKEND_DAEMON => Backend::Daemon,
        PM_BACKEND_IN_PROCESS => Backend::InProcess,
        _ => return Err(Failure::argument("no such backend")),
    });
    if let Some(instance) = read(options.instance)? {
        builder = builder.instance(instance);
    }
    if let Some(dir) = read(options.runtime_dir)? {
        #[cfg(feature = "daemon")]
        {
            builder = builder.runtime_dir(std::path::PathBuf::from(dir));
        }
        #[cfg(not(feature = "daemon"))]
        let _ = dir;
    }
    if let Some(engine) = read(options.engine)? {
        builder = builder.engine(engine.parse()?);
    }
    if let Some(encoding) = read(options.encoding)? {
        builder = builder.encoding(encoding.parse()?);
    }
    if let Some(isa) = read(options.isa)? {
        builder = builder.isa(isa.parse()?);
    }
    if options.threads > 0 {
        builder = builder.threads(options.threads as usize);
    }
    if options.visit_threads > 0 {
        builder = builder.visit_threads(options.visit_threads as usize);
    }
    if options.capacity > 0 {
        builder = builder.capacity(BoxCount::new(options.capacity));
    }
    match options.spin_ns {
        0 => {}
        u64::MAX => builder = builder.spin(Duration::ZERO),
        ns => builder = builder.spin(Duration::from_nanos(ns)),
    }
    if options.deadline_ns > 0 {
        builder = builder.deadline(Duration::from_nanos(options.deadline_ns));
    }
    let session = builder.answer_repeats(options.no_repeats == 0).connect()?;
    Ok(Session { session, spares: Spares::default() })
}

/// Ends a session. What came of it lives on: frames, masks and scenes.
#[unsafe(no_mangle)]
pub extern "C" fn pm_session_drop(session: pm_session) -> pm_code {
    session.drop()
}

/// What would serve the next frame by the present state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_served_by(
    session: pm_session,
    served_by: *mut pm_served_by,
) -> pm_code {
    call(|| {
        let by = session.with(|s| Ok(s.session.served_by()))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(served_by, served_by_number(by)) }
    })
}

/// The number of what answered.
pub const fn served_by_number(by: ServedBy) -> pm_served_by {
    match by {
        ServedBy::Daemon => PM_SERVED_BY_DAEMON,
        ServedBy::InProcess => PM_SERVED_BY_THIS_PROCESS,
    }
}

/// What a daemon tells of itself.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_daemon_status {
    /// `sizeof(pm_daemon_status)`, set by the caller.
    pub struct_size: usize,
    /// Id of its process.
    pub pid: u32,
    /// Clients that are connected.
    pub client_count: u32,
    /// Nanoseconds since it began to serve.
    pub uptime_ns: u64,
    /// Frames answered.
    pub frames: u64,
    /// Boxes in those frames.
    pub boxes: u64,
    /// Pairs in those frames.
    pub pairs: u64,
    /// Spheres in those frames.
    pub spheres: u64,
    /// Requests answered with an error.
    pub errors: u64,
    /// Scenes that it keeps.
    pub scenes: u32,
    /// Memory that they take, MiB.
    pub scene_mib: u32,
}

/// Asks the daemon for its status.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_daemon_status(
    session: pm_session,
    status: *mut pm_daemon_status,
) -> pm_code {
    call(|| {
        check_out(status)?;
        let reported = session.with(|s| Ok(s.session.daemon_status()?))?;
        let facts = pm_daemon_status {
            struct_size: 0,
            pid: reported.pid,
            client_count: reported.client_count,
            uptime_ns: reported.uptime_ns,
            frames: reported.frames,
            boxes: reported.boxes,
            pairs: reported.pairs,
            spheres: reported.spheres,
            errors: reported.errors,
            scenes: reported.scenes,
            scene_mib: reported.scene_mib,
        };
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_growing(status, &facts) }
    })
}
