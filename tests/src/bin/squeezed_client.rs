//! Clients that connect while shared memory is nearly full. `squeezed_client STEP_BYTES MOST_BYTES`,
//! with a daemon's directory in `PAIRMASK_RUNTIME_DIR`, in a mount namespace with a small /dev/shm
//! of its own.
//!
//! For every free size from 0 to `MOST_BYTES` in steps, it fills the rest and starts a client of
//! each backend, which connects and submits a frame. Each client has to end by itself: with the
//! right pairs, or with an error that names the missing memory. The binary prints the number of each
//! outcome.

use std::error::Error;
use std::fs::{File, remove_file};
use std::os::unix::process::ExitStatusExt;
use std::process::Command;

use pairmask::{Backend, ConnectError, ServedBy, Session};
use pairmask_core::Aabb;

const FILLER: &str = "/dev/shm/filler";
/// Boxes of a frame: two pages of them.
const BOXES: usize = 300;
/// Output of a client that the daemon served.
const SERVED: &str = "served";
/// Output of a client that got an error about missing memory.
const REFUSED: &str = "refused";
/// Output of a client that found its pairs in process.
const IN_PROCESS: &str = "in process";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.as_slice() {
        [backend] => {
            println!("{}", ask(backend.parse()?)?);
            Ok(())
        }
        [step, most] => squeeze(step.parse()?, most.parse()?),
        _ => Err("one backend, or a step and the most bytes that are free".into()),
    }
}

/// Connects and submits a frame.
fn ask(backend: Backend) -> Result<&'static str, Box<dyn Error>> {
    let mut session = match Session::builder().backend(backend).connect() {
        Ok(session) => session,
        Err(ConnectError::OutOfMemory) => return Ok(REFUSED),
        Err(error) => return Err(error.into()),
    };
    let answer = session.frame(BOXES).and_then(|mut frame| {
        frame.boxes_mut().fill(Aabb::EMPTY);
        frame.boxes_mut()[7] = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        frame.boxes_mut()[9] = frame.boxes()[7];
        frame.submit()
    });
    let mask = match answer
        .map_err(|e| e.to_string())
        .and_then(|p| p.wait().map_err(|e| e.to_string()))
    {
        Ok(mask) => mask,
        Err(text) if backend == Backend::Daemon && is_about_memory(&text) => return Ok(REFUSED),
        Err(text) => return Err(text.into()),
    };
    if mask.to_vec() != [(7, 9)] {
        return Err(format!("wrong pairs: {:?}", mask.to_vec()).into());
    }
    Ok(match mask.info().served_by {
        ServedBy::Daemon => SERVED,
        ServedBy::InProcess => IN_PROCESS,
    })
}

fn is_about_memory(text: &str) -> bool {
    text.contains("no shared memory") || text.contains("out-of-memory")
}

fn squeeze(step: u64, most: u64) -> Result<(), Box<dyn Error>> {
    let (mut served, mut refused, mut in_process) = (0, 0, 0);
    let own = std::env::current_exe()?;
    for free in (0..=most).step_by(usize::try_from(step)?) {
        for backend in ["daemon", "auto"] {
            leave(free)?;
            let output = Command::new(&own).arg(backend).output()?;
            let said = String::from_utf8_lossy(&output.stdout).trim().to_owned();
            let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
            if !output.status.success() {
                let signal = output.status.signal();
                return Err(format!(
                    "{free} bytes free, {backend}: ended by signal {signal:?}: {complaint}"
                )
                .into());
            }
            match said.as_str() {
                SERVED => served += 1,
                REFUSED => refused += 1,
                IN_PROCESS if backend == "auto" => in_process += 1,
                other => return Err(format!("{free} bytes free, {backend}: {other}").into()),
            }
        }
    }
    remove_file(FILLER)?;
    println!("served {served}, refused {refused}, in process {in_process}");
    Ok(())
}

/// Fills shared memory up to `free` bytes.
fn leave(free: u64) -> Result<(), Box<dyn Error>> {
    // The free size is known only without the filler file.
    let _ = remove_file(FILLER);
    let space = rustix::fs::statvfs("/dev/shm")?;
    let available = space.f_bavail * space.f_frsize;
    let file = File::create(FILLER)?;
    let bytes = available.saturating_sub(free);
    if bytes > 0 {
        rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes)?;
    }
    Ok(())
}
