//! Daemons in a test's own process, with answers that the test chooses.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::service::ipc_threadsafe;
use pairmask_core::units::BoxCount;
use pairmask_transport::{DaemonRecord, Limits, RuntimeDir, Services, assume_response_pages};
use pairmask_wire::{
    InstanceName, ReplyFields, RequestHeader, ResponseHeader, StatusCode, Version, response_error,
    words_in_mut,
};

/// The fields of a request that every response echoes.
pub fn fields_of(header: &RequestHeader) -> ReplyFields {
    ReplyFields {
        client_token: header.client_token,
        frame: header.frame,
        box_count: BoxCount::new(header.box_count),
    }
}

/// Answers every request until `stop`: `answer` writes one page and returns the header. The daemon
/// states this build's version.
///
/// # Panics
/// When the services cannot be made.
pub fn answer_all(
    dir: &RuntimeDir,
    stop: &AtomicBool,
    answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader,
) {
    answer_all_as(Version::CURRENT, dir, stop, answer);
}

/// As [`answer_all`], by a daemon that states another version.
///
/// # Panics
/// When the services cannot be made.
pub fn answer_all_as(
    version: Version,
    dir: &RuntimeDir,
    stop: &AtomicBool,
    mut answer: impl FnMut(&RequestHeader, &mut [u32]) -> ResponseHeader,
) {
    let (name, limits) = (InstanceName::default(), Limits::default());
    dir.ensure_transport_root(&name).expect("the transport's directory");
    let services =
        Services::<ipc_threadsafe::Service>::serve(dir, &name, &limits).expect("services");
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

/// Refuses every request until `stop`, as a daemon does that does not know a required section. It
/// still states this build's version.
///
/// # Panics
/// When the services cannot be made.
pub fn refuse_all(dir: &RuntimeDir, stop: &AtomicBool) {
    answer_all(dir, stop, |header, _| {
        response_error(&fields_of(header), StatusCode::BadRequest, [0; 2])
    });
}
