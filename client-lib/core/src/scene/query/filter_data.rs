//! What queries are to the rules of a scene.

use crate::engine::CullError;
use crate::filters::FilterData;
use crate::scene::query::BeyondMask;
use crate::scene::rules::FilterHistory;

/// The filter data of queries: their worlds, owners and filters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum QueryFilterData<'a> {
    /// None: a query meets every box.
    #[default]
    None,
    /// One for all queries.
    One(FilterData),
    /// One for each query.
    Each(&'a [FilterData]),
}

impl From<FilterData> for QueryFilterData<'_> {
    fn from(filter_data: FilterData) -> Self {
        Self::One(filter_data)
    }
}

impl<'a> From<&'a [FilterData]> for QueryFilterData<'a> {
    fn from(filter_data: &'a [FilterData]) -> Self {
        Self::Each(filter_data)
    }
}

/// Why queries have no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// Not as much filter data as queries.
    #[error(
        "filter data of {filter_data} queries for {queries} queries: give it for each, or once for all"
    )]
    FilterData {
        /// Queries.
        queries: usize,
        /// Their filter data.
        filter_data: usize,
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

impl QueryFilterData<'_> {
    /// Checks that there is one for each of so many queries, if each has one.
    ///
    /// # Errors
    /// [`QueryError::FilterData`].
    pub const fn check(&self, queries: usize) -> Result<(), QueryError> {
        match self {
            Self::Each(filter_data) if filter_data.len() != queries => {
                Err(QueryError::FilterData { queries, filter_data: filter_data.len() })
            }
            _ => Ok(()),
        }
    }

    /// The filter data of a query; `None` where it meets every box.
    pub fn of(&self, query: u32) -> Option<FilterData> {
        match self {
            Self::None => None,
            Self::One(filter_data) => Some(*filter_data),
            Self::Each(filter_data) => filter_data.get(query as usize).copied(),
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
            let of_box = || filters.filter_data(*index, is_still(*index));
            self.of(*query)
                .is_none_or(|filter_data| filters.rules().may_meet(&filter_data, &of_box()))
        });
    }
}
