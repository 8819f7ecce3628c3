//! Daemons in a test's own process, with answers that the test chooses.

use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pairmask_core::units::BoxCount;
use pairmask_transport::{
    DaemonRecord, Limits, ResponseLoan, RuntimeDir, Services, assume_response_pages,
    clean_if_abandoned,
};
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

/// Serves as a daemon of a version whose answers have one page, until it is over. `answer` writes each and sends it by
/// a function that says whether that was possible.
pub fn serve(
    version: Version,
    dir: &RuntimeDir,
    limits: &Limits,
    is_over: impl Fn() -> bool,
    mut answer: impl FnMut(&RequestHeader, ResponseLoan, &mut dyn FnMut(ResponseLoan) -> bool),
) -> Result<(), Box<dyn Error>> {
    let (name, pid) = (InstanceName::default(), std::process::id());
    dir.ensure_transport_root(&name)?;
    let services = Services::serve(dir, &name, limits)?;
    let server = services.server(limits, &std::sync::Arc::default())?;
    let ports = services.wake_ports()?;
    let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version };
    dir.write_record(&name, &record)?;
    while !is_over() {
        let Ok(Some(request)) = server.receive() else {
            std::thread::sleep(Duration::from_micros(50));
            continue;
        };
        let Ok(loan) = request.loan_slice_uninit(1) else { continue };
        answer(request.user_header(), assume_response_pages(loan), &mut |loan| {
            let is_sent = loan.send().is_ok();
            let _ = ports.1.notify();
            is_sent
        });
    }
    Ok(())
}

/// Runs `test` beside a daemon of a version, whose answers `answer` gives: it writes one page and returns the header.
pub fn beside_daemon(
    version: Version,
    mut answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader + Send,
    test: impl FnOnce(&RuntimeDir),
) {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let dir = RuntimeDir::at(dir.path());
    let stop = AtomicBool::new(false);
    let (stop, dir) = (&stop, &dir);
    let is_over = || stop.load(Ordering::Relaxed);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let limits = Limits::default();
            let served = serve(version, dir, &limits, is_over, |header, mut loan, send| {
                let words = words_in_mut(loan.payload_mut());
                words.fill(0);
                let response = answer(header, words);
                *loan.user_header_mut() = response;
                assert!(send(loan), "the client listens");
            });
            served.expect("the services work");
        });
        eventually("it serves", || dir.read_record(&InstanceName::default()));
        // A failed test stops the daemon too, and does not wait for it for ever.
        let result = catch_unwind(AssertUnwindSafe(|| test(dir)));
        stop.store(true, Ordering::Relaxed);
        if let Err(panic) = result {
            resume_unwind(panic);
        }
    });
    clean_if_abandoned(dir, &InstanceName::default()).expect("nobody serves");
}
