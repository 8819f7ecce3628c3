//! Recordings: the requests of a daemon's clients, and the digest of each answer, in a file.
//!
//! A request is recorded when it is served, before its work begins: whatever a client sends because of an answer stands
//! behind the requests that this answer is of, those of other clients too. Sent again in this order, one at a time, the
//! requests get the same answers. `RECORDING.md` describes the file.
//!
//! ```text
//! answered   what an answer holds, and its digest     (pure)
//! asked      what a frame asks of a session           (pure)
//! record     what stands in a recording               (pure)
//! block      records in a compressed block            (pure)
//! reader     a recording, block by block
//! file       a recording that is written, of bounded size
//! recorder   what serving threads hand over, and the thread that writes it
//! ```

mod answered;
mod asked;
mod block;
mod file;
mod reader;
mod record;
mod recorder;

pub use answered::{Answered, Entry, Set, entries};
pub use asked::{Asked, AskedFrame, FrameReader, pages_of};
pub use file::{RecordError, RecordFile, RecordSettings};
pub use reader::{ReadError, Recording};
pub use record::{Event, MOST_PAYLOAD_BYTES, Record, SessionEnd};
pub(crate) use recorder::{RecordTicket, Recorder};
