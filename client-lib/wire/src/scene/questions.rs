//! What queries and casts have in their payload: boxes, rays or spheres, and filter data behind them.

use bytemuck::AnyBitPattern;
use pairmask_core::filters::FilterData;
use pairmask_core::scene::QueryFilterData;

use crate::header::RequestHeader;
use crate::page::Page;
use crate::reject::Reject;
use crate::section::{SECTION_COUNT, Section, SectionKind, find, has, slots};

const FILTER_DATA_BYTES: u64 = size_of::<FilterData>() as u64;
/// Filter data begin on a cache line.
const LINE_BYTES: u64 = 64;

/// Sections of the payload, which is long enough for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Questions {
    entries: Section,
    /// One for all, or one for each.
    filter_data: Option<Section>,
}

impl Questions {
    /// So many of a kind, each of so many bytes.
    pub fn new(
        kind: SectionKind,
        entry_bytes: u64,
        count: u64,
        filter_data: &QueryFilterData<'_>,
    ) -> Self {
        let entries = Section::required(kind, 0, entry_bytes * count);
        let at = entries.bytes.next_multiple_of(LINE_BYTES);
        let section =
            |count| Section::required(SectionKind::QueryFilterData, at, FILTER_DATA_BYTES * count);
        let filter_data = match filter_data {
            QueryFilterData::None => None,
            // A single one has one entry of filter data either way.
            QueryFilterData::Each(_) => Some(section(count)),
            QueryFilterData::One(_) => Some(section(1)),
        };
        Self { entries, filter_data }
    }

    pub fn payload_bytes(&self) -> u64 {
        self.filter_data
            .map_or(self.entries.bytes, |filter_data| filter_data.offset + filter_data.bytes)
    }

    /// The slots of a header.
    pub fn slots(&self) -> [Section; SECTION_COUNT] {
        slots([self.entries].into_iter().chain(self.filter_data))
    }

    /// Writes them into the payload. Whether there is room for them.
    ///
    /// # Panics
    /// Where they are not as many as the sections say.
    #[must_use]
    pub fn write(
        &self,
        entries: &[u8],
        filter_data: &QueryFilterData<'_>,
        pages: &mut [Page],
    ) -> bool {
        let mut put = |section: &Section, bytes: &[u8]| {
            assert_eq!(section.bytes, bytes.len() as u64, "as many as the request says");
            section.put(bytes, pages, false)
        };
        let filter_data: &[FilterData] = match filter_data {
            QueryFilterData::None => &[],
            QueryFilterData::Each(filter_data) => filter_data,
            QueryFilterData::One(filter_data) => std::slice::from_ref(filter_data),
        };
        let filter_data_fit =
            self.filter_data.is_none_or(|section| put(&section, bytemuck::cast_slice(filter_data)));
        filter_data_fit && put(&self.entries, entries)
    }

    /// The boxes, rays or spheres in the payload, which another process may write while they are read; `None` where
    /// they are not all there.
    pub fn entries<'a, T: AnyBitPattern>(&self, pages: &'a [Page]) -> Option<&'a [T]> {
        self.entries.entries_in(pages)
    }

    /// The same of their filter data.
    pub fn filter_data<'a>(&self, pages: &'a [Page]) -> Option<QueryFilterData<'a>> {
        Some(match &self.filter_data {
            None => QueryFilterData::None,
            Some(section) if section.bytes == FILTER_DATA_BYTES => {
                QueryFilterData::One(*section.entries_in(pages)?.first()?)
            }
            Some(section) => QueryFilterData::Each(section.entries_in(pages)?),
        })
    }

    /// Those of a copied header, and how many there are.
    pub fn parse(
        header: &RequestHeader,
        (kind, entry_bytes, field): (SectionKind, u64, &'static str),
        payload_bytes: u64,
    ) -> Result<(Self, u64), Reject> {
        let section = |kind, entry_bytes, field| {
            let section = find(&header.sections, kind, entry_bytes, payload_bytes);
            section.ok_or(Reject::Query(field))
        };
        let entries = section(kind, entry_bytes, field)?;
        let count = entries.bytes / entry_bytes;
        let has_filter_data = has(&header.sections, SectionKind::QueryFilterData);
        let filter_data = has_filter_data
            .then(|| section(SectionKind::QueryFilterData, FILTER_DATA_BYTES, "filter data"));
        let filter_data = filter_data.transpose()?;
        if filter_data.is_some_and(|filter_data| {
            ![1, count].contains(&(filter_data.bytes / FILTER_DATA_BYTES))
        }) {
            return Err(Reject::Query("filter data"));
        }
        Ok((Self { entries, filter_data }, count))
    }
}
