//! Transport: how a client and a daemon find each other and share memory.
//!
//! Each side writes to memory of its own, which iceoryx2 lends, and reads the other's. What each has sent, and let go
//! of, stands on its board. The wire contract (`WIRE.md` of `pairmask-wire`) draws it.
//!
//! ```text
//! instance, runtime_dir, trust, foreign, liveness, status_file   files by which a daemon is found, and whether it lives
//! cleanup                                                        what killed processes left
//! socket, door                                                   who is let in; descriptors of memory
//! pool, segment, guard, memory, room, fork                       own memory, the other's, what may be missing
//! board, handshake                                               what was sent, and let go of
//! budget                                                         memory that a daemon may take, by client
//! counters                                                       what each client took, for who looks at the daemon
//! peer                                                           a client as its daemon has it
//! link, waiting, sent, receiving, exchange, vigil                a daemon as its client has it
//! ```

mod board;
mod budget;
mod cleanup;
mod counters;
mod door;
mod error;
mod exchange;
mod foreign;
mod fork;
mod guard;
mod handshake;
mod instance;
mod limits;
mod link;
mod link_error;
mod liveness;
mod locked;
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

use std::sync::atomic;

pub use budget::{Budget, Charge, Memory, OverBudget, Share};
pub use cleanup::{LeftFile, left_files, remove_left_files};
pub use counters::{
    Answered, AnsweredOf, AnsweredTotals, ClientCounts, ClientSlot, CounterSample, Counters,
    ProcessNote, SceneCounts, SceneSlot, TotalCounts,
};
pub use door::Door;
pub use error::{OpenError, TransportError};
pub use exchange::{Answer, AnswerMemory, Exchange};
pub use foreign::{foreign_owner, instance_sockets};
pub use guard::install as survive_cut_memory;
pub use instance::{DaemonRecord, InstanceLock, RuntimeDir};
pub use limits::{FRAMES_AT_A_TIME, Limits, quiet_transport_log};
pub use link::{ConnectFailure, Link, LinkOptions, Slot};
pub use link_error::LinkError;
pub use liveness::{
    BEAT_INTERVAL, DaemonWatch, Heartbeat, ProcessWatch, SILENT_AFTER, Stillness, process_name,
};
pub use peer::{CheckedRequest, Peer, Sender};
pub use pool::{Chunk, Pool};
pub use process_limits::{LimitError, raise_file_limit};
pub use room::PopulateError;
pub use segment::{Mapping, Segment};
pub use sent::{CheckedResponse, SharedFrame, Unsent};
pub use status_file::{GpuCounts, StatusFile};
pub use vigil::LeftDaemon;
