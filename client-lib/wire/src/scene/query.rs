//! A query of a scene: which boxes of it some other boxes overlap. Its answer is that of a frame.

use pairmask_core::aabb::Aabb;
use pairmask_core::mask::Encoding;
use pairmask_core::scene::{QueryFilterData, QueryMask};

use super::questions::Questions;
use super::request::{BOX_BYTES, SceneId};
use crate::header::{Operation, RequestHeader, thread_number, threads_of};
use crate::page::Page;
use crate::reject::Reject;
use crate::section::SectionKind;

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
    questions: Questions,
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
        let questions = Questions::new(SectionKind::Boxes, BOX_BYTES, queries, filter_data);
        Self { scene, revision, mask, encoding, threads: None, questions }
    }

    /// Bytes of the payload.
    pub fn payload_bytes(&self) -> u64 {
        self.questions.payload_bytes()
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
        self.questions.write(bytemuck::cast_slice(boxes), filter_data, pages)
    }

    /// The boxes and filter data in the payload, which another process may write while they are read; `None` where
    /// they are not all there.
    pub fn read<'a>(&self, pages: &'a [Page]) -> Option<(&'a [Aabb], QueryFilterData<'a>)> {
        Some((self.questions.entries(pages)?, self.questions.filter_data(pages)?))
    }

    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let revision = (header.base != 0).then_some(header.base);
        let found = header.encoding;
        let encoding = Encoding::from_wire(found).ok_or(Reject::Encoding(found))?;
        let boxes = (SectionKind::Boxes, BOX_BYTES, "boxes");
        let (questions, queries) = Questions::parse(header, boxes, payload_bytes)?;
        let index_end = u64::from(header.box_count).checked_sub(queries);
        // Both are at most the object count.
        let mask = index_end.and_then(|end| QueryMask::new(queries as usize, end as u32));
        let mask = mask.ok_or(Reject::Query("object count"))?;
        Ok(Self {
            scene: SceneId(header.scene),
            revision,
            mask,
            encoding,
            threads: threads_of(header.threads),
            questions,
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
            sections: request.questions.slots(),
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
    use crate::section::Section;
    use pairmask_core::filters::{FilterData, World};

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
