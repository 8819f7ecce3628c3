//! Transport: how a client and a daemon find each other and share memory (iceoryx2 0.10).
//!
//! Everything that both sides must agree on stands here: names, service settings, the instance's
//! place on disk. The settings are those that measurements asked for; each says why.

mod account_file;
mod cleanup;
mod foreign;
mod instance;
mod liveness;
mod memory;
mod message;
mod name;
mod own_request;
mod pages;
mod room;
mod runtime_dir;
mod segment;
mod services;
mod spinner;
mod trust;

pub use account_file::Account;
pub use cleanup::{clean_if_abandoned, remove_hollow_files};
pub use foreign::foreign_owner;
pub use instance::{DaemonRecord, InstanceError, InstanceLock, InstanceName, RuntimeDir};
pub use liveness::{ProcessWatch, process_name};
pub use memory::{PopulateError, Populated, populate};
pub use message::{CheckedRequest, CheckedResponse, ForgedRequest};
pub use own_request::{OwnRequest, SentRequest};
pub use pages::{
    assume_pages, assume_response_pages, boxes_in, boxes_in_mut, bytes_in_mut, narrow_boxes_in,
    objects_in, spheres_in, spheres_in_mut, words_in, words_in_mut,
};
pub use segment::{Segment, SegmentFiles};
pub use services::{
    ActiveRequest, Client, ClientNode, ClientPort, DaemonNode, FRAMES_AT_A_TIME, JANITOR_INTERVAL,
    Limits, OpenError, PORTS_PER_CLIENT, PendingResponse, RequestLoan, ResponseLoan,
    ResponseSample, Sender, Server, Services, TransportError, WakeClient, WakeDaemon,
    listener_name, quiet_transport_log,
};
pub use spinner::Spinner;
