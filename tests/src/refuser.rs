//! Daemons in a test's own process, with answers that the test chooses.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pairmask_core::units::BoxCount;
use pairmask_transport::{
    DaemonRecord, Limits, RuntimeDir, Services, assume_response_pages, clean_if_abandoned,
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

/// Answers every request until `stop` as a daemon of a version: `answer` writes one page and returns the header.
fn answer_all(
    version: Version,
    dir: &RuntimeDir,
    stop: &AtomicBool,
    mut answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader,
) {
    let (name, limits) = (InstanceName::default(), Limits::default());
    dir.ensure_transport_root(&name).expect("the transport's directory");
    let services = Services::serve(dir, &name, &limits).expect("services");
    let server = services.server(&limits, &std::sync::Arc::default()).expect("a server");
    let pid = std::process::id();
    let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version };
    dir.write_record(&name, &record).expect("a record");
    while !stop.load(Ordering::Relaxed) {
        if let Some(request) = server.receive().expect("the services work") {
            let header = *request.user_header();
            let loan = request.loan_slice_uninit(1).expect("a page");
            let mut loan = assume_response_pages(loan);
            let words = words_in_mut(loan.payload_mut());
            words.fill(0);
            let response = answer(&header, words);
            *loan.user_header_mut() = response;
            loan.send().expect("the client listens");
        }
        std::thread::sleep(Duration::from_millis(1));
    }
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
    std::thread::scope(|scope| {
        scope.spawn(move || answer_all(version, dir, stop, answer));
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
