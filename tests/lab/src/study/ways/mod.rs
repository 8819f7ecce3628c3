//! Cases, a scene of some size each, that are culled in several ways, interleaved.

mod case;
mod threads;
mod timed_way;

pub use case::{Case, CaseTimes, Effort, WaySet, measure_case};
pub use threads::{Pools, core_count, thread_counts};
pub use timed_way::Way;
