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
use std::process::Command;

use pairmask::{Backend, ConnectError, PairMask, ServedBy, Session};
use pairmask_core::Aabb;

const FILLER: &str = "/dev/shm/filler";
/// Boxes of a frame: two pages of them.
const BOXES: usize = 300;
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

fn ask(backend: Backend) -> Result<&'static str, Box<dyn Error>> {
    let mut session = match Session::builder().backend(backend).connect() {
        Ok(session) => session,
        Err(ConnectError::OutOfMemory | ConnectError::DaemonFull { .. }) => return Ok(REFUSED),
        Err(error) => return Err(error.into()),
    };
    let mut boxes = [Aabb::EMPTY; BOXES];
    boxes[7] = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    boxes[9] = boxes[7];
    let mut answer = || -> Result<PairMask, Box<dyn Error>> {
        let mut frame = session.frame(BOXES)?;
        frame.write(&boxes)?;
        Ok(frame.submit()?.wait()?)
    };
    match answer() {
        Ok(mask) if mask.to_vec() != [[7, 9]] => Err("wrong pairs".into()),
        Ok(mask) if mask.info().served_by == ServedBy::Daemon => Ok(SERVED),
        Ok(_) => Ok(IN_PROCESS),
        Err(error) if backend == Backend::Daemon && is_about_memory(&error.to_string()) => {
            Ok(REFUSED)
        }
        Err(error) => Err(error),
    }
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
            let said = String::from_utf8_lossy(&output.stdout);
            match said.trim() {
                SERVED if output.status.success() => served += 1,
                REFUSED if output.status.success() => refused += 1,
                IN_PROCESS if output.status.success() && backend == "auto" => in_process += 1,
                _ => return Err(format!("{free} bytes free, {backend}: {output:?}").into()),
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
