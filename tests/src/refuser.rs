//! A daemon in a test's own process that refuses whatever it is asked.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::service::ipc;
use pairmask::transport::{
    DaemonRecord, InstanceName, Limits, RuntimeDir, Services, assume_response_pages,
};
use pairmask::units::BoxCount;
use pairmask::wire::{ReplyFields, StatusCode, Version, response_error};

/// Refuses every request until `stop`, as a daemon does that does not know a required section, and
/// says all the same that it is of this build's version.
///
/// # Panics
/// When the services cannot be made.
pub fn refuse_all(dir: &RuntimeDir, stop: &AtomicBool) {
    let (name, limits) = (InstanceName::default(), Limits::default());
    let services = Services::<ipc::Service>::serve(dir, &name, &limits).expect("services");
    let server = services.server(&limits).expect("a server");
    let pid = std::process::id();
    let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version: Version::CURRENT };
    dir.write_record(&name, &record).expect("a record");
    while !stop.load(Ordering::Relaxed) {
        if let Some(request) = server.receive().expect("the services work") {
            let header = *request.user_header();
            let fields = ReplyFields {
                client_token: header.client_token,
                frame: header.frame,
                box_count: BoxCount::new(header.box_count),
            };
            let loan = request.loan_slice_uninit(1).expect("a page");
            let mut loan = assume_response_pages(loan);
            *loan.user_header_mut() = response_error(&fields, StatusCode::BadRequest, [0; 2]);
            loan.send().expect("the client listens");
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
