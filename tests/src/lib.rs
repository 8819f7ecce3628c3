//! Oracle, conformance suite, fault tests and benches of pairmask.
// Helpers of tests panic, or give the mistake, where a test has failed: none says so by itself.
#![allow(clippy::missing_errors_doc, clippy::missing_panics_doc)]
// Not published: a comment stands where a name does not say it all.
#![allow(missing_docs)]

pub mod attackers;
pub mod audited;
pub mod cancelled;
pub mod casts;
pub mod command_line;
pub mod conformance;
pub mod daemon;
pub mod fault_client;
pub mod filtered_frames;
pub mod frame_memory;
pub mod frames;
pub mod golden;
pub mod gpu;
pub mod mask_writer;
pub mod measure;
pub mod narrow;
pub mod peers;
pub mod prelude;
pub mod queried;
pub mod refuser;
pub mod scene_model;
pub mod session_engine;
pub mod spheres;
pub mod tier;

pub use pairmask_core::oracle;
pub use pairmask_core::oracle::modes as naive_modes;
pub use pairmask_core::oracle::naive_decoder;
pub use pairmask_lab::sabotage::lose_a_pair;
pub use pairmask_lab::stress::{SphereCase, scenes as stress_scenes};
pub use tier::attack_time;
