//! Rules of a whole frame: which boxes may meet, and where the pairs of each world stand.
//!
//! ```text
//! entries  filters and pairs as words, as edits of scenes write them too   (pure)
//! sections where the rules lie in a request, validated                    (pure)
//! layout   rules into a request
//! cached   what a client knows of the rules that a daemon keeps
//! reader   rules out of a request, kept from frame to frame
//! worlds   the ranges of worlds in a reply                                 (pure)
//! ```

mod cached;
pub(crate) mod entries;
mod layout;
mod reader;
mod sections;
mod worlds;

pub use cached::{CachedRules, RulesNumber};
pub use layout::{RulesLayout, TooManyPairs};
pub use reader::{RulesReader, SentRules};
pub(crate) use sections::PARTS;
pub use sections::RulesSections;
pub use worlds::{WORLD_RANGE_WORDS, world_ranges_in, write_world_ranges};
