//! Persistent scenes: boxes stay from answer to answer, edits go in, changes of pairs come out.
//!
//! ```text
//! options   what a session asks of a scene
//! lists     what is reported, in the memory of the daemon's answer or of the scene
//! sharing   the membership of a scene that several processes write
//! question  what a scene is asked, in a daemon or in this process
//! remote    a scene that a daemon keeps, with the copy that this process keeps
//! backend   the scene, kept by a daemon or in this process, with margins or without
//! answer    the answer to an edit
//! edit      what an edit does, until it is sent
//! query     which boxes some other boxes overlap
//! cast      which boxes rays hit, and which are nearest
//! observe   which boxes of a shared scene changed, regardless of who wrote them
//! shift     worlds whose origin moves
//! snapshots scenes that go back to what they were
//! file      scenes that are saved, and loaded again
//! ```

mod answer;
mod backend;
mod cast;
mod edit;
mod file;
mod lists;
mod observe;
mod options;
mod query;
mod question;
mod remote;
mod sharing;
mod shift;
mod snapshots;

pub use self::answer::SceneAnswer;
pub use self::backend::Scene;
pub use self::cast::HitAnswer;
pub use self::edit::SceneEdit;
pub use self::options::SceneOptions;
pub use self::query::QueryAnswer;
