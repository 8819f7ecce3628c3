//! A query of a scene: which boxes of it some other boxes overlap. Its answer is that of a frame.

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::FilterData;
use pairmask_core::mask::Encoding;
use pairmask_core::scene::{QueryFilterData, QueryMask};

use super::request::{BOX_BYTES, SceneId};
use crate::header::{Operation, RequestHeader, thread_number, threads_of};
use crate::page::Page;
use crate::reject::Reject;
use crate::section::{Section, SectionKind, find, has, slots};

const FILTER_DATA_BYTES: u64 = size_of::<FilterData>() as u64;
/// Filter data begin on a cache line.
const LINE_BYTES: u64 = 64;

/// A query of a scene: what a client says in a header, and what a daemon has validated of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueryRequest {
    /// The scene, among those of the session, or its membership of a shared scene.
    pub scene: SceneId,
    /// The revision of the scene that is asked, which is that of the client's last edit. `None` asks a shared scene,
    /// as the last tick made it.
    pub revision: Option<u64>,
    /// What the mask is of: queries, and boxes with indices below the client's last one.
    pub mask: QueryMask,
    /// How the mask is written.
    pub encoding: Encoding,
    /// Threads that may be used; `None` leaves the number to the daemon.
    pub threads: Option<usize>,
    boxes: Section,
    /// Filter data in the payload: one for all queries, or one for each.
    filter_data: Option<Section>,
}

impl QueryRequest {
    /// A query of a scene, whose boxes and filter data lie as [`write`](Self::write) puts them.
    pub fn new(
        scene: SceneId,
        revision: Option<u64>,
        mask: QueryMask,
        encoding: Encoding,
        filter_data: &QueryFilterData<'_>,
    ) -> Self {
        let queries = u64::from(mask.queries());
        let boxes = Section::required(SectionKind::Boxes, 0, BOX_BYTES * queries);
        let at = boxes.bytes.next_multiple_of(LINE_BYTES);
        let section =
            |count| Section::required(SectionKind::QueryFilterData, at, FILTER_DATA_BYTES * count);
        let filter_data = match filter_data {
            QueryFilterData::None => None,
            // A single query has one entry of filter data either way.
            QueryFilterData::Each(_) => Some(section(queries)),
            QueryFilterData::One(_) => Some(section(1)),
        };
        Self { scene, revision, mask, encoding, threads: None, boxes, filter_data }
    }

    /// Bytes of the payload.
    pub fn payload_bytes(&self) -> u64 {
        self.filter_data
            .map_or(self.boxes.bytes, |filter_data| filter_data.offset + filter_data.bytes)
    }

    /// Writes boxes and filter data into the payload. Whether there is room for them.
    ///
    /// # Panics
    /// Where they are not as many as the request says.
    #[must_use]
    pub fn write(
        &self,
        boxes: &[Aabb],
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
        filter_data_fit && put(&self.boxes, bytemuck::cast_slice(boxes))
    }

    /// The boxes and filter data in the payload, which another process may write while they are read; `None` where
    /// they are not all there.
    pub fn read<'a>(&self, pages: &'a [Page]) -> Option<(&'a [Aabb], QueryFilterData<'a>)> {
        let filter_data = match &self.filter_data {
            None => QueryFilterData::None,
            Some(section) if section.bytes == FILTER_DATA_BYTES => {
                QueryFilterData::One(*section.entries_in(pages)?.first()?)
            }
            Some(section) => QueryFilterData::Each(section.entries_in(pages)?),
        };
        Some((self.boxes.entries_in(pages)?, filter_data))
    }

    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let revision = (header.base != 0).then_some(header.base);
        let found = header.encoding;
        let encoding = Encoding::from_wire(found).ok_or(Reject::Encoding(found))?;
        let section = |kind, entry_bytes, field| {
            let section = find(&header.sections, kind, entry_bytes, payload_bytes);
            section.ok_or(Reject::Query(field))
        };
        let boxes = section(SectionKind::Boxes, BOX_BYTES, "boxes")?;
        let queries = boxes.bytes / BOX_BYTES;
        let index_end = u64::from(header.box_count).checked_sub(queries);
        // Both are at most the object count.
        let mask = index_end.and_then(|end| QueryMask::new(queries as usize, end as u32));
        let mask = mask.ok_or(Reject::Query("object count"))?;
        let has_filter_data = has(&header.sections, SectionKind::QueryFilterData);
        let filter_data = has_filter_data
            .then(|| section(SectionKind::QueryFilterData, FILTER_DATA_BYTES, "filter data"));
        let filter_data = filter_data.transpose()?;
        if filter_data.is_some_and(|filter_data| {
            ![1, queries].contains(&(filter_data.bytes / FILTER_DATA_BYTES))
        }) {
            return Err(Reject::Query("filter data"));
        }
        Ok(Self {
            scene: SceneId(header.scene),
            revision,
            mask,
            encoding,
            threads: threads_of(header.threads),
            boxes,
            filter_data,
        })
    }
}

impl RequestHeader {
    /// A query of a scene.
    pub fn query_scene(client_token: u64, frame: u64, request: &QueryRequest) -> Self {
        Self {
            box_count: request.mask.n().get(),
            encoding: request.encoding as u32,
            threads: thread_number(request.threads),
            sections: slots([request.boxes].into_iter().chain(request.filter_data)),
            scene: request.scene.0,
            base: request.revision.unwrap_or(0),
            ..Self::envelope(Operation::QueryScene, client_token, frame)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Request;
    use pairmask_core::filters::World;

    const PAGE: u64 = size_of::<Page>() as u64;

    fn request(queries: usize, filter_data: &QueryFilterData<'_>) -> QueryRequest {
        let mask = QueryMask::new(queries, 1_000).expect("few");
        let revision = [None, Some(7)][queries % 2];
        QueryRequest::new(SceneId(3), revision, mask, Encoding::List, filter_data)
    }

    fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<QueryRequest, Reject> {
        match Request::parse(header, payload_bytes)? {
            Request::QueryScene(request) => Ok(request),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let in_world = |world| FilterData::default().with_world(World(world));
        for queries in [0, 1, 2, 3, 170, 171] {
            let boxes: Vec<Aabb> = (0..queries).map(|i| Aabb::point([i as f32; 3])).collect();
            let each: Vec<FilterData> = (0..queries as i32).map(in_world).collect();
            for filter_data in [
                QueryFilterData::None,
                QueryFilterData::One(in_world(9)),
                QueryFilterData::Each(&each),
            ] {
                let sent = request(queries, &filter_data);
                let mut pages = vec![
                    bytemuck::Zeroable::zeroed();
                    sent.payload_bytes().div_ceil(PAGE) as usize
                ];
                assert!(sent.write(&boxes, &filter_data, &mut pages));
                let header = RequestHeader::query_scene(1, 2, &sent);
                let got = parse(&header, PAGE * pages.len() as u64).expect("right");
                assert_eq!(got, sent);
                let (read, read_filter_data) = got.read(&pages).expect("all there");
                assert_eq!(read, boxes);
                match (filter_data, queries) {
                    (QueryFilterData::Each(filter_data), 1) => {
                        assert_eq!(read_filter_data, QueryFilterData::One(filter_data[0]));
                    }
                    _ => assert_eq!(read_filter_data, filter_data),
                }
                if sent.payload_bytes() > 0 {
                    assert!(parse(&header, sent.payload_bytes() - 1).is_err());
                }
                assert!(got.read(&[]).is_none() || sent.payload_bytes() == 0);
            }
        }
    }

    #[test]
    fn forged_queries_are_refused() {
        let filter_data = [FilterData::default(); 5];
        let right =
            RequestHeader::query_scene(1, 2, &request(5, &QueryFilterData::Each(&filter_data)));
        assert!(parse(&right, PAGE).is_ok());
        let forgeries: [&dyn Fn(&mut RequestHeader); 12] = [
            &|h| h.encoding = 99,
            &|h| h.box_count = 4,
            &|h| h.sections[0].bytes += 1,
            &|h| h.sections[0].bytes = u64::MAX - 23,
            &|h| h.sections[0].offset = u64::MAX - 3,
            &|h| h.sections[0].offset = 2,
            &|h| h.sections[0] = Section::default(),
            &|h| h.sections[2] = h.sections[0],
            &|h| h.sections[1].bytes = 24,
            &|h| h.sections[1].bytes = 0,
            &|h| h.sections[1].offset = PAGE,
            &|h| h.sections[3] = h.sections[1],
        ];
        for (number, forge) in forgeries.iter().enumerate() {
            let mut forged = right;
            forge(&mut forged);
            assert!(parse(&forged, PAGE).is_err(), "forgery {number}");
        }
    }

    #[test]
    fn filter_data_belongs_to_queries_alone() {
        let mut header = RequestHeader::query_scene(
            1,
            2,
            &request(5, &QueryFilterData::One(FilterData::default())),
        );
        header.operation = Operation::Cull as u32;
        header.box_count = 5;
        let found = SectionKind::QueryFilterData as u32;
        assert_eq!(Request::parse(&header, PAGE), Err(Reject::UnknownSection(found)));
    }
}
