//! Sessions: `pm_session`.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::time::Duration;

use pairmask::Backend;
use pairmask_core::units::BoxCount;

use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{Growing, In, Out};
use crate::spares::Spares;
use crate::values::{pm_served_by, served_by_number};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_session {
    pub id: u64,
}

/// What a `pm_session` names.
pub struct Session {
    pub session: pairmask::Session,
    pub spares: Spares,
}

pub type pm_backend = u32;
pub const PM_BACKEND_AUTO: pm_backend = 0;
pub const PM_BACKEND_DAEMON: pm_backend = 1;
pub const PM_BACKEND_IN_PROCESS: pm_backend = 2;

#[derive(Clone, Copy, Default)]
#[repr(C)]
pub struct pm_session_options {
    pub struct_size: usize,
    pub instance: In<c_char>,
    pub runtime_dir: In<c_char>,
    pub engine: In<c_char>,
    pub encoding: In<c_char>,
    pub isa: In<c_char>,
    pub backend: pm_backend,
    pub threads: u32,
    pub visit_threads: u32,
    pub capacity: u32,
    pub spin_ns: u64,
    pub deadline_ns: u64,
    pub no_repeats: u32,
}

// SAFETY: it is `repr(C)` and begins with its size; pointers and integers have no invalid bit patterns.
unsafe impl Growing for pm_session_options {}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_connect(
    options: In<pm_session_options>,
    session: Out<pm_session>,
) -> pm_code {
    session.give(|| pm_session::new(connect(&options.growing()?)?))
}

fn connect(options: &pm_session_options) -> Result<Session, Failure> {
    let mut builder = pairmask::Session::builder().backend(match options.backend {
        PM_BACKEND_AUTO => Backend::Auto,
        PM_BACKEND_DAEMON => Backend::Daemon,
        PM_BACKEND_IN_PROCESS => Backend::InProcess,
        _ => return Err(Failure::argument("no such backend")),
    });
    if let Some(instance) = options.instance.text()? {
        builder = builder.instance(instance);
    }
    if let Some(dir) = options.runtime_dir.text()? {
        #[cfg(feature = "daemon")]
        {
            builder = builder.runtime_dir(std::path::PathBuf::from(dir));
        }
        #[cfg(not(feature = "daemon"))]
        let _ = dir;
    }
    if let Some(engine) = options.engine.text()? {
        builder = builder.engine(engine.parse()?);
    }
    if let Some(encoding) = options.encoding.text()? {
        builder = builder.encoding(encoding.parse()?);
    }
    if let Some(isa) = options.isa.text()? {
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

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_drop(session: pm_session) -> pm_code {
    session.drop()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_served_by(
    session: pm_session,
    served_by: Out<pm_served_by>,
) -> pm_code {
    served_by.give(|| session.with(|s| Ok(served_by_number(s.session.served_by()))))
}

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_daemon_status {
    pub struct_size: usize,
    pub pid: u32,
    pub client_count: u32,
    pub uptime_ns: u64,
    pub frames: u64,
    pub boxes: u64,
    pub pairs: u64,
    pub spheres: u64,
    pub errors: u64,
    pub scenes: u32,
    pub scene_mib: u32,
}

// SAFETY: it is `repr(C)` and begins with its size; integers have no invalid bit patterns.
unsafe impl Growing for pm_daemon_status {}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_daemon_status(
    session: pm_session,
    status: Out<pm_daemon_status>,
) -> pm_code {
    status.give_growing(|| {
        let reported = session.with(|s| Ok(s.session.daemon_status()?))?;
        Ok(pm_daemon_status {
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
            ..Default::default()
        })
    })
}
