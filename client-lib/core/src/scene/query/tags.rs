//! What queries are to the rules of a scene.

use crate::aabb::Aabb;
use crate::engine::CullError;
use crate::filters::{Rules, Tag};
use crate::scene::filtered::PairScene;
use crate::scene::pair_list::Pair;
use crate::scene::query::BeyondMask;

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

/// Why queries have no answer.
#[derive(Debug, thiserror::Error)]
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

    /// Keeps the pairs that may meet. Boxes of a scene without rules have no tag but what is static.
    pub(in crate::scene) fn filter(
        &self,
        scene: &impl PairScene,
        rules: Option<&Rules>,
        found: &mut Vec<Pair>,
    ) {
        if matches!(self, Self::None) {
            return;
        }
        let none = Rules::default();
        let either = rules.unwrap_or(&none);
        found.retain(|[query, index]| {
            let of_box = || match rules {
                Some(rules) => rules.tag(*index),
                None => Tag::default().with_static(scene.is_static(*index)),
            };
            self.of(*query).is_none_or(|tag| either.tags_meet(&tag, &of_box()))
        });
    }
}
