//! Sessions: `pm_session`.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::time::Duration;

use pairmask::{Backend, Session, SessionBuilder};
use pairmask_core::units::BoxCount;

use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::mask::free_spares;
use crate::memory::{In, Out};
use crate::values::{if_any, pm_served_by, served_by_number};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_session {
    pub id: u64,
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
    pub iterate_threads: u32,
    pub capacity: u32,
    pub spin_ns: u64,
    pub deadline_ns: u64,
    pub no_repeats: u32,
}

growing!(pm_session_options);

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_connect(
    options: In<pm_session_options>,
    session: Out<pm_session>,
) -> pm_code {
    session.give(|| pm_session::new(connect(&options.growing()?)?))
}

fn connect(options: &pm_session_options) -> Result<Session, Failure> {
    let backend = match options.backend {
        PM_BACKEND_AUTO => Backend::Auto,
        PM_BACKEND_DAEMON => Backend::Daemon,
        PM_BACKEND_IN_PROCESS => Backend::InProcess,
        _ => return Err(Failure::argument("no such backend")),
    };
    let builder = Session::builder().backend(backend);
    // Each option that is given is folded into the builder.
    let builder = options.instance.text()?.into_iter().fold(builder, SessionBuilder::instance);
    let dir = options.runtime_dir.text()?;
    #[cfg(feature = "daemon")]
    let builder =
        dir.map(std::path::PathBuf::from).into_iter().fold(builder, SessionBuilder::runtime_dir);
    #[cfg(not(feature = "daemon"))]
    let _ = dir;
    let engine = options.engine.text()?.map(str::parse).transpose()?;
    let builder = engine.into_iter().fold(builder, SessionBuilder::engine);
    let encoding = options.encoding.text()?.map(str::parse).transpose()?;
    let builder = encoding.into_iter().fold(builder, SessionBuilder::encoding);
    let isa = options.isa.text()?.map(str::parse).transpose()?;
    let builder = isa.into_iter().fold(builder, SessionBuilder::isa);
    let count = |setting| if_any(setting).map(|count: u32| count as usize);
    let builder = count(options.threads).into_iter().fold(builder, SessionBuilder::threads);
    let builder =
        count(options.iterate_threads).into_iter().fold(builder, SessionBuilder::iterate_threads);
    let capacity = if_any(options.capacity).map(BoxCount::new);
    let builder = capacity.into_iter().fold(builder, SessionBuilder::capacity);
    let spin = if_any(options.spin_ns).map(|ns| if ns == u64::MAX { 0 } else { ns });
    let builder = spin.map(Duration::from_nanos).into_iter().fold(builder, SessionBuilder::spin);
    let deadline = if_any(options.deadline_ns).map(Duration::from_nanos);
    let builder = deadline.into_iter().fold(builder, SessionBuilder::deadline);
    Ok(builder.answer_repeats(options.no_repeats == 0).connect()?)
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_drop(session: pm_session) -> pm_code {
    free_spares();
    session.drop()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_served_by(
    session: pm_session,
    served_by: Out<pm_served_by>,
) -> pm_code {
    served_by.give(|| session.with(|s| Ok(served_by_number(s.served_by()))))
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

growing!(pm_daemon_status);

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_daemon_status(
    session: pm_session,
    status: Out<pm_daemon_status>,
) -> pm_code {
    status.give_growing(|| {
        let reported = session.with(|s| Ok(s.daemon_status()?))?;
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
