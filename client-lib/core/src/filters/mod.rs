//! Filters: which boxes may be a pair at all, regardless of their places.
//!
//! Each box carries a [`FilterData`]: its world, its owner, and a place in a scene's [table](FilterTable) of
//! [filters](Filter). [`Rules`] decide whether two boxes meet, in this order:
//!
//! 1. Boxes of different worlds never meet. [`World::ALL`] is in all of them.
//! 2. A pair on the include list is reported.
//! 3. Boxes of one owner never meet, unless it is [`Owner::NONE`].
//! 4. Two static boxes never meet.
//! 5. A pair on the exclude list never meets.
//! 6. Equal groups other than 0 decide by their sign: positive always, negative never.
//! 7. Else the categories and masks decide: [`Filter::admits`].
//!
//! A pair is reported where its boxes overlap and the rules let them meet: a pair of the include list too
//! has to overlap.
//!
//! The rule is one that the filters of other engines can be written in: see [`engines`].

pub mod engines;
mod filter;
mod filter_data;
mod pair_lists;
mod rules;
mod table;
#[cfg(test)]
mod tests;

pub use self::filter::Filter;
pub use self::filter_data::{FilterData, FilterId, Owner, World};
pub use self::pair_lists::PairLists;
pub(crate) use self::pair_lists::{Listed, in_order};
pub use self::rules::Rules;
pub(crate) use self::rules::decide;
pub use self::table::{FilterTable, TooManyFilters};
