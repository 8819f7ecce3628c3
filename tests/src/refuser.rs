//! Daemons in a test's own process, with answers that the test chooses.

use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pairmask_core::units::BoxCount;
use pairmask_transport::{Budget, Counters, DaemonRecord, Door, Limits, RuntimeDir};
use pairmask_wire::{
    InstanceName, ReplyFields, RequestHeader, ResponseHeader, Version, words_in_mut,
};

use crate::daemon::eventually;

pub fn fields_of(header: &RequestHeader) -> ReplyFields {
    ReplyFields {
        client_token: header.client_token,
        frame: header.frame,
        box_count: BoxCount::new(header.box_count),
    }
}

/// Serves as a daemon of a version, until it is over: `answer` writes one page of each answer and returns the header.
fn serve(
    version: Version,
    dir: &RuntimeDir,
    is_over: impl Fn() -> bool,
    mut answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader,
) -> Result<(), Box<dyn Error>> {
    let (name, pid) = (InstanceName::default(), std::process::id());
    dir.ensure()?;
    let Limits { max_clients, max_memory_bytes, .. } = Limits::default();
    let budget = Budget::new(max_memory_bytes, max_clients);
    let door = Door::open(dir, &name, max_clients, budget, Counters::unseen(max_clients))?;
    let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version, fences: 0 };
    dir.write_record(&name, &record)?;
    std::thread::scope(|scope| {
        let porter = scope.spawn(|| door.attend());
        while !is_over() {
            for peer in door.peers() {
                peer.receive(|request| {
                    let Ok(mut chunk) = request.lend(1) else { return };
                    let words = words_in_mut(chunk.pages_mut());
                    words.fill(0);
                    let header = answer(request.header(), words);
                    request.answer(&header, chunk);
                });
            }
            std::thread::sleep(Duration::from_micros(50));
        }
        door.end();
        porter.join().unwrap_or_else(|panic| resume_unwind(panic))
    })?;
    dir.remove_record(&name);
    Ok(())
}

/// Runs `test` beside a daemon of a version, whose answers `answer` gives: it writes one page and returns the header.
pub fn beside_daemon(
    version: Version,
    answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader + Send,
    test: impl FnOnce(&RuntimeDir),
) {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let dir = RuntimeDir::at(dir.path());
    let stop = AtomicBool::new(false);
    let (stop, dir) = (&stop, &dir);
    let is_over = || stop.load(Ordering::Relaxed);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            serve(version, dir, is_over, answer).expect("the socket can be served");
        });
        eventually("it serves", || dir.read_record(&InstanceName::default()));
        // A failed test stops the daemon too, and does not wait for it for ever.
        let result = catch_unwind(AssertUnwindSafe(|| test(dir)));
        stop.store(true, Ordering::Relaxed);
        if let Err(panic) = result {
            resume_unwind(panic);
        }
    });
}
