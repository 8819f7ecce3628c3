//! The filters of a scene, and which of them meet.

use super::filter::Filter;
use super::filter_data::FilterId;

/// Filters up to which it is computed once which of them meet: a bit for each two, 128 KiB in all. More are
/// compared pair by pair.
const COMPUTED_MOST: usize = 1 << 10;

/// The filters of a scene, by [`FilterId`]. An id beyond the last one is [`Filter::ALL`].
///
/// ```
/// use pairmask_core::filters::{Filter, FilterId, FilterTable};
///
/// let table = FilterTable::new(&[Filter::new(1, 2), Filter::new(2, 3)])?;
/// assert!(table.meet(FilterId(0), FilterId(1)));
/// assert!(!table.meet(FilterId(0), FilterId(0)));
/// # Ok::<(), pairmask_core::filters::TooManyFilters>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FilterTable {
    filters: Vec<Filter>,
    /// Bit b of row a: whether they meet. Empty where there are many.
    meets: Vec<u64>,
    row_words: usize,
}

/// More filters than ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{count} filters: there are ids for 65,536")]
#[non_exhaustive]
pub struct TooManyFilters {
    /// How many there were.
    pub count: usize,
}

impl FilterTable {
    /// A table of these.
    ///
    /// # Errors
    /// [`TooManyFilters`] beyond 65,536.
    pub fn new(filters: &[Filter]) -> Result<Self, TooManyFilters> {
        let count = filters.len();
        if count > 1 << 16 {
            return Err(TooManyFilters { count });
        }
        let mut table = Self { filters: filters.to_vec(), meets: Vec::new(), row_words: 0 };
        if count <= COMPUTED_MOST {
            table.row_words = count.div_ceil(64);
            table.meets = vec![0; count * table.row_words];
            for (a, row) in filters.iter().zip(table.meets.chunks_mut(table.row_words.max(1))) {
                for (at, b) in filters.iter().enumerate() {
                    row[at / 64] |= u64::from(may_meet(a, b)) << (at % 64);
                }
            }
        }
        Ok(table)
    }

    /// The filters.
    pub fn filters(&self) -> &[Filter] {
        &self.filters
    }

    /// A filter.
    #[inline]
    pub fn get(&self, id: FilterId) -> Filter {
        self.filters.get(usize::from(id.0)).copied().unwrap_or(Filter::ALL)
    }

    /// Whether boxes of two filters meet, as far as the filters say: rules 4, 6 and 7 of the
    /// [order](crate::filters).
    #[inline]
    pub fn meet(&self, a: FilterId, b: FilterId) -> bool {
        let [a_at, b_at] = [a, b].map(|id| usize::from(id.0));
        let computed = self.meets.get(a_at * self.row_words + b_at / 64);
        match computed {
            Some(word) if a_at.max(b_at) < self.filters.len() => word >> (b_at % 64) & 1 == 1,
            _ => may_meet(&self.get(a), &self.get(b)),
        }
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.filters.capacity() * size_of::<Filter>() + self.meets.capacity() * size_of::<u64>()
    }
}

const fn may_meet(a: &Filter, b: &Filter) -> bool {
    !(a.is_static && b.is_static) && a.admits(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filters(count: usize) -> Vec<Filter> {
        let of = |i: usize| {
            let i = i as u64;
            let filter = Filter::new(i % 5, i % 7).with_group((i % 4) as i32 - 2);
            filter.with_static(i.is_multiple_of(3)).with_either(i % 8 < 4)
        };
        (0..count).map(of).collect()
    }

    #[test]
    fn what_is_computed_is_what_the_filters_say() {
        for count in [0, 1, 2, 63, 64, 65, 130, COMPUTED_MOST, COMPUTED_MOST + 1] {
            let filters = filters(count);
            let table = FilterTable::new(&filters).expect("few filters");
            let ids = (0..count.min(140)).chain(count.saturating_sub(3)..count + 2);
            for a in ids.clone() {
                for b in ids.clone() {
                    let of = |at: usize| filters.get(at).copied().unwrap_or(Filter::ALL);
                    let expected = may_meet(&of(a), &of(b));
                    let ids = [a, b].map(|at| FilterId(at as u16));
                    assert_eq!(table.meet(ids[0], ids[1]), expected, "{a} and {b} of {count}");
                    assert_eq!(table.meet(ids[1], ids[0]), expected, "{b} and {a} of {count}");
                }
            }
        }
    }

    #[test]
    fn a_table_has_as_many_filters_as_there_are_ids() {
        assert!(FilterTable::new(&vec![Filter::ALL; 1 << 16]).is_ok());
        let more = FilterTable::new(&vec![Filter::ALL; (1 << 16) + 1]);
        assert_eq!(more, Err(TooManyFilters { count: 65_537 }));
    }
}
