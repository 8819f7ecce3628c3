//! Transport: how a client and a daemon find each other and share memory (iceoryx2 0.10).
//!
//! This crate holds what both sides must agree on: names, service settings, the instance's place on
//! disk. Each setting has its reason beside it.

mod board;
mod cleanup;
mod door;
mod error;
mod exchange;
mod foreign;
mod guard;
mod instance;
mod limits;
mod link;
mod link_error;
mod liveness;
mod memory;
mod peer;
mod pool;
mod process_limits;
mod receiving;
mod room;
mod runtime_dir;
mod segment;
mod sent;
mod socket;
mod status_file;
mod trust;
mod vigil;
mod waiting;

pub use cleanup::remove_left_files;
pub use door::Door;
pub use error::{OpenError, TransportError};
pub use exchange::{Answer, AnswerMemory, Exchange};
pub use foreign::foreign_owner;
pub use guard::install as survive_cut_memory;
pub use instance::{DaemonRecord, InstanceLock, RuntimeDir};
pub use limits::{FRAMES_AT_A_TIME, JANITOR_INTERVAL, Limits, quiet_transport_log};
pub use link::{ConnectFailure, Link, LinkOptions, Slot};
pub use link_error::LinkError;
pub use liveness::{
    BEAT_INTERVAL, DaemonWatch, Heartbeat, ProcessWatch, SILENT_AFTER, Stillness, process_name,
};
pub use memory::populate;
pub use peer::{CheckedRequest, Peer, Sender};
pub use pool::{Chunk, Pool};
pub use process_limits::{LimitError, no_files_left, raise_file_limit};
pub use room::PopulateError;
pub use segment::{Mapping, Segment};
pub use sent::{CheckedResponse, SharedFrame, Unsent};
pub use status_file::{GpuCounts, StatusFile};
pub use vigil::{LeftDaemon, Seen, Vigil, WAIT_SLICE, Watched};
