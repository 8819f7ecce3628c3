//! Rules of a whole frame: which boxes may meet, and where the pairs of each world stand.
//!
//! ```text
//! items    filters and pairs as words, as edits of scenes write them too   (pure)
//! place    where the rules lie in a request, validated                     (pure)
//! layout   rules into a request
//! reader   rules out of a request, kept from frame to frame
//! worlds   the ranges of worlds in a reply                                 (pure)
//! ```

pub(crate) mod items;
mod layout;
mod place;
mod reader;
mod worlds;

pub use layout::{RulesLayout, TooManyPairs};
pub(crate) use place::PARTS;
pub use place::RulesPlace;
pub use reader::{RulesReader, SentRules};
pub use worlds::{WORLD_RANGE_WORDS, world_ranges_in, write_world_ranges};
