//! Transport: how a client and a daemon find each other and share memory (iceoryx2 0.10).
//!
//! This crate holds what both sides must agree on: names, service settings, the instance's place on
//! disk. Each setting has its reason beside it.

mod alarm;
mod cleanup;
mod exchange;
mod foreign;
mod free_chunks;
mod instance;
mod link;
mod liveness;
mod loans;
mod memory;
mod message;
mod own_request;
mod process_limits;
mod room;
mod runtime_dir;
mod segment;
mod services;
mod status_file;
mod trust;
mod turn;
mod umask;
mod vigil;

pub use alarm::sleep_until;
pub use cleanup::{clean_if_abandoned, remove_hollow_files, segment_file};
pub use exchange::{Answer, AnswerMemory, Exchange};
pub use foreign::foreign_owner;
pub use free_chunks::{ChunkLook, FreeChunk, FreeChunks};
pub use instance::{DaemonRecord, InstanceLock, RuntimeDir};
pub use link::{ConnectFailure, Link, LinkError, LinkOptions, SharedFrame, Slot, Unsent};
pub use liveness::{
    BEAT_INTERVAL, DaemonWatch, Heartbeat, ProcessWatch, SILENT_AFTER, Stillness, process_name,
};
pub use loans::{assume_pages, assume_response_pages};
pub use memory::{Populated, populate, populate_beyond};
pub use message::{CheckedRequest, CheckedResponse, ForgedRequest};
pub use own_request::{OwnRequest, SentRequest};
pub use process_limits::{LimitError, address_space_left, no_files_left, raise_file_limit};
pub use room::PopulateError;
pub use segment::{Mapping, Segment, SegmentFiles};
pub use services::{
    ActiveRequest, Client, ClientPort, DaemonNode, FRAMES_AT_A_TIME, JANITOR_INTERVAL, Limits,
    OpenError, PORTS_PER_CLIENT, PendingResponse, RequestLoan, ResponseLoan, ResponseSample,
    Sender, Server, Services, TransportError, WakeClient, WakeDaemon, listener_name,
    quiet_transport_log,
};
pub use status_file::{GpuCounts, StatusFile};
pub use turn::PortTurn;
pub use vigil::{LeftDaemon, Seen, Vigil, WAIT_SLICE, Watched};
