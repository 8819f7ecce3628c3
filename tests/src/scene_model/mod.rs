//! A naive model of scenes, against which random edits over all verbs are driven.
//!
//! ```text
//! model     boxes and filters as plain tables; all pairs by comparing all boxes; what a listener is to be reported
//! generate  random scripts: edits, answers that nobody acknowledges, members that join and leave
//! check     plays a script on a scene and on the model, and compares each answer
//! shrink    the smallest script that still fails, printed as Rust that runs
//! grouped   ops as the steps of an edit
//! subjects  the scenes that are held to the model, of the cores, of a GPU and of sessions
//! members   the members of a shared scene, held to it
//! beside_core  a scene of a GPU beside one of the cores
//! ```

mod beside_core;
mod check;
mod generate;
mod grouped;
mod members;
mod model;
mod script;
mod shrink;
mod subjects;

pub use self::beside_core::BesideCore;
pub use self::check::{Failure, Seen, Subject, check};
pub use self::generate::{Edits, Kind, script_of};
pub use self::grouped::{Grouped, a_margin, margins_for};
pub use self::members::{Sessions, SharedMembers};
pub use self::model::{Listener, Model, PairsByGeneration, Received, ended, overlap};
pub use self::script::{
    AtEnd, EndReason, Ended, Event, Fate, Mode, Op, Pair, Scope, Script, Turn, at, one, turn,
};
pub use self::shrink::{
    hold, hold_all, hold_scripts, hold_without_rules, script_with_snapshots, shrunk,
};
pub use self::subjects::{Bare, BareScene, CoreScene, Moment, SessionScene, options};
