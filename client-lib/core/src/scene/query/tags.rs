//! What queries are to the rules of a scene.

use crate::aabb::Aabb;
use crate::engine::CullError;
use crate::filters::Tag;
use crate::scene::query::BeyondMask;
use crate::scene::rules::FilterHistory;

/// The tags of queries: their worlds, owners and filters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum QueryTags<'a> {
    /// None: a query meets every box.
    #[default]
    None,
    /// One for all queries.
    One(Tag),
    /// One for each query.
    Each(&'a [Tag]),
}

impl From<Tag> for QueryTags<'_> {
    fn from(tag: Tag) -> Self {
        Self::One(tag)
    }
}

impl<'a> From<&'a [Tag]> for QueryTags<'a> {
    fn from(tags: &'a [Tag]) -> Self {
        Self::Each(tags)
    }
}

/// Why queries have no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// Not as many tags as queries.
    #[error("{tags} tags for {queries} queries: give one for each, or one for all")]
    Tags {
        /// Queries.
        queries: usize,
        /// Their tags.
        tags: usize,
    },
    /// The boxes cannot be found, or there is no room for them.
    #[error(transparent)]
    Cull(#[from] CullError),
}

impl From<BeyondMask> for QueryError {
    fn from(beyond: BeyondMask) -> Self {
        Self::Cull(beyond.into())
    }
}

impl QueryTags<'_> {
    /// Checks that there is one for each query, if each has one.
    ///
    /// # Errors
    /// [`QueryError::Tags`].
    pub const fn check(&self, queries: &[Aabb]) -> Result<(), QueryError> {
        match self {
            Self::Each(tags) if tags.len() != queries.len() => {
                Err(QueryError::Tags { queries: queries.len(), tags: tags.len() })
            }
            _ => Ok(()),
        }
    }

    /// The tag of a query; `None` where it meets every box.
    pub fn of(&self, query: u32) -> Option<Tag> {
        match self {
            Self::None => None,
            Self::One(tag) => Some(*tag),
            Self::Each(tags) => tags.get(query as usize).copied(),
        }
    }

    /// Keeps the pairs that may meet by the filters of a scene, given the filter data of its boxes. Lists decide
    /// nothing: a query has no index.
    pub fn filter(
        &self,
        filters: &FilterHistory,
        is_still: impl Fn(u32) -> bool,
        found: &mut Vec<[u32; 2]>,
    ) {
        if matches!(self, Self::None) {
            return;
        }
        found.retain(|[query, index]| {
            let of_box = || filters.tag(*index, is_still(*index));
            self.of(*query).is_none_or(|tag| filters.rules().tags_meet(&tag, &of_box()))
        });
    }
}
