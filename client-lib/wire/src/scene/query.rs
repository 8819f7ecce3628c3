//! A query of a scene: which boxes of it some other boxes overlap. Its answer is that of a frame.

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::Tag;
use pairmask_core::mask::Encoding;
use pairmask_core::scene::{QueryMask, QueryTags};

use super::request::{BOX_BYTES, SceneId};
use crate::header::{Operation, RequestHeader, thread_number, threads_of};
use crate::page::Page;
use crate::reject::Reject;
use crate::section::{Section, SectionKind, find, has, slots};

const TAG_BYTES: u64 = size_of::<Tag>() as u64;
/// Tags begin on a cache line.
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
    /// Tags in the payload: one for all queries, or one for each.
    tags: Option<Section>,
}

impl QueryRequest {
    /// A query of a scene, whose boxes and tags lie as [`write`](Self::write) puts them.
    pub fn new(
        scene: SceneId,
        revision: Option<u64>,
        mask: QueryMask,
        encoding: Encoding,
        tags: &QueryTags<'_>,
    ) -> Self {
        let queries = u64::from(mask.queries());
        let boxes = Section::required(SectionKind::Boxes, 0, BOX_BYTES * queries);
        let at = boxes.bytes.next_multiple_of(LINE_BYTES);
        let section = |count| Section::required(SectionKind::QueryTags, at, TAG_BYTES * count);
        let tags = match tags {
            QueryTags::None => None,
            // A single query has one tag either way.
            QueryTags::Each(_) => Some(section(queries)),
            QueryTags::One(_) => Some(section(1)),
        };
        Self { scene, revision, mask, encoding, threads: None, boxes, tags }
    }

    /// Bytes of the payload.
    pub fn payload_bytes(&self) -> u64 {
        self.tags.map_or(self.boxes.bytes, |tags| tags.offset + tags.bytes)
    }

    /// Writes boxes and tags into the payload. Whether there is room for them.
    ///
    /// # Panics
    /// Where they are not as many as the request says.
    #[must_use]
    pub fn write(&self, boxes: &[Aabb], tags: &QueryTags<'_>, pages: &mut [Page]) -> bool {
        let mut put = |section: &Section, bytes: &[u8]| {
            assert_eq!(section.bytes, bytes.len() as u64, "as many as the request says");
            section.put(bytes, pages, false)
        };
        let tags: &[Tag] = match tags {
            QueryTags::None => &[],
            QueryTags::Each(tags) => tags,
            QueryTags::One(tag) => std::slice::from_ref(tag),
        };
        let tags_fit = self.tags.is_none_or(|section| put(&section, bytemuck::cast_slice(tags)));
        tags_fit && put(&self.boxes, bytemuck::cast_slice(boxes))
    }

    /// The boxes and tags in the payload, which another process may write while they are read; `None` where
    /// they are not all there.
    pub fn read<'a>(&self, pages: &'a [Page]) -> Option<(&'a [Aabb], QueryTags<'a>)> {
        let tags = match &self.tags {
            None => QueryTags::None,
            Some(section) if section.bytes == TAG_BYTES => {
                QueryTags::One(*section.items_in(pages)?.first()?)
            }
            Some(section) => QueryTags::Each(section.items_in(pages)?),
        };
        Some((self.boxes.items_in(pages)?, tags))
    }

    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let revision = (header.base != 0).then_some(header.base);
        let found = header.encoding;
        let encoding = Encoding::from_wire(found).ok_or(Reject::Encoding(found))?;
        let section = |kind, item_bytes, field| {
            let section = find(&header.sections, kind, item_bytes, payload_bytes);
            section.ok_or(Reject::Query(field))
        };
        let boxes = section(SectionKind::Boxes, BOX_BYTES, "boxes")?;
        let queries = boxes.bytes / BOX_BYTES;
        let index_end = u64::from(header.box_count).checked_sub(queries);
        // Both are at most the object count.
        let mask = index_end.and_then(|end| QueryMask::new(queries as usize, end as u32));
        let mask = mask.ok_or(Reject::Query("object count"))?;
        let has_tags = has(&header.sections, SectionKind::QueryTags);
        let tags = has_tags.then(|| section(SectionKind::QueryTags, TAG_BYTES, "tags"));
        let tags = tags.transpose()?;
        if tags.is_some_and(|tags| ![1, queries].contains(&(tags.bytes / TAG_BYTES))) {
            return Err(Reject::Query("tags"));
        }
        Ok(Self {
            scene: SceneId(header.scene),
            revision,
            mask,
            encoding,
            threads: threads_of(header.threads),
            boxes,
            tags,
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
            sections: slots([request.boxes].into_iter().chain(request.tags)),
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

    fn request(queries: usize, tags: &QueryTags<'_>) -> QueryRequest {
        let mask = QueryMask::new(queries, 1_000).expect("few");
        let revision = [None, Some(7)][queries % 2];
        QueryRequest::new(SceneId(3), revision, mask, Encoding::List, tags)
    }

    fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<QueryRequest, Reject> {
        match Request::parse(header, payload_bytes)? {
            Request::QueryScene(request) => Ok(request),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let tag = |world| Tag::default().with_world(World(world));
        for queries in [0, 1, 2, 3, 170, 171] {
            let boxes: Vec<Aabb> = (0..queries).map(|i| Aabb::point([i as f32; 3])).collect();
            let tags: Vec<Tag> = (0..queries as i32).map(tag).collect();
            for tags in [QueryTags::None, QueryTags::One(tag(9)), QueryTags::Each(&tags)] {
                let sent = request(queries, &tags);
                let mut pages = vec![
                    bytemuck::Zeroable::zeroed();
                    sent.payload_bytes().div_ceil(PAGE) as usize
                ];
                assert!(sent.write(&boxes, &tags, &mut pages));
                let header = RequestHeader::query_scene(1, 2, &sent);
                let got = parse(&header, PAGE * pages.len() as u64).expect("right");
                assert_eq!(got, sent);
                let (read, read_tags) = got.read(&pages).expect("all there");
                assert_eq!(read, boxes);
                match (tags, queries) {
                    (QueryTags::Each(tags), 1) => assert_eq!(read_tags, QueryTags::One(tags[0])),
                    _ => assert_eq!(read_tags, tags),
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
        let tags = [Tag::default(); 5];
        let right = RequestHeader::query_scene(1, 2, &request(5, &QueryTags::Each(&tags)));
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
    fn tags_belong_to_queries_alone() {
        let mut header =
            RequestHeader::query_scene(1, 2, &request(5, &QueryTags::One(Tag::default())));
        header.operation = Operation::Cull as u32;
        header.box_count = 5;
        let found = SectionKind::QueryTags as u32;
        assert_eq!(Request::parse(&header, PAGE), Err(Reject::UnknownSection(found)));
    }
}
