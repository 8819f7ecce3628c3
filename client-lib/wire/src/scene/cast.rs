//! A cast into a scene: which of its boxes rays hit, or spheres touch, in the order of their distance.

use pairmask_core::cast::{HIT_BYTES, Hit, Hits, RAY_BYTES, Shapes};
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::scene::QueryFilterData;
use pairmask_core::sphere::SPHERE_BYTES;

use super::questions::Questions;
use super::request::SceneId;
use crate::header::{Operation, RequestHeader, thread_number, threads_of};
use crate::page::Page;
use crate::reject::Reject;
use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope, stages, times_of};
use crate::section::{Section, SectionKind, find, has, slots};
use crate::status_code::StatusCode;

/// What is cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Rays,
    Spheres,
}

impl Kind {
    const fn section(self) -> (SectionKind, u64, &'static str) {
        match self {
            Self::Rays => (SectionKind::Rays, RAY_BYTES as u64, "rays"),
            Self::Spheres => (SectionKind::Spheres, SPHERE_BYTES as u64, "spheres"),
        }
    }
}

/// A cast into a scene: what a client says in a header, and what a daemon has validated of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CastRequest {
    /// The scene, among those of the session, or its membership of a shared scene.
    pub scene: SceneId,
    /// The revision of the scene that is asked, which is that of the client's last edit. `None` asks a shared scene,
    /// as the last tick made it.
    pub revision: Option<u64>,
    /// Which boxes are reported.
    pub hits: Hits,
    /// Threads that may be used; `None` leaves the number to the daemon.
    pub threads: Option<usize>,
    kind: Kind,
    count: u32,
    questions: Questions,
}

impl CastRequest {
    /// A cast whose shapes and filter data lie as [`write`](Self::write) puts them; `None` where there are 2^32 shapes or
    /// more.
    pub fn new(
        scene: SceneId,
        revision: Option<u64>,
        shapes: Shapes<'_>,
        hits: Hits,
        filter_data: &QueryFilterData<'_>,
    ) -> Option<Self> {
        let count = u32::try_from(shapes.len()).ok()?;
        let kind = match shapes {
            Shapes::Rays(_) => Kind::Rays,
            Shapes::Spheres(_) => Kind::Spheres,
        };
        let (section, entry_bytes, _) = kind.section();
        let questions = Questions::new(section, entry_bytes, count.into(), filter_data);
        Some(Self { scene, revision, hits, threads: None, kind, count, questions })
    }

    /// Rays or spheres.
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// Bytes of the payload.
    pub fn payload_bytes(&self) -> u64 {
        self.questions.payload_bytes()
    }

    /// Writes shapes and filter data into the payload. Whether there is room for them.
    ///
    /// # Panics
    /// Where they are not as many as the request says.
    #[must_use]
    pub fn write(
        &self,
        shapes: Shapes<'_>,
        filter_data: &QueryFilterData<'_>,
        pages: &mut [Page],
    ) -> bool {
        let bytes = match shapes {
            Shapes::Rays(rays) => bytemuck::cast_slice(rays),
            Shapes::Spheres(spheres) => bytemuck::cast_slice(spheres),
        };
        self.questions.write(bytes, filter_data, pages)
    }

    /// The shapes and filter data in the payload, which another process may write while they are read; `None` where
    /// they are not all there.
    pub fn read<'a>(&self, pages: &'a [Page]) -> Option<(Shapes<'a>, QueryFilterData<'a>)> {
        let shapes = match self.kind {
            Kind::Rays => Shapes::Rays(self.questions.entries(pages)?),
            Kind::Spheres => Shapes::Spheres(self.questions.entries(pages)?),
        };
        Some((shapes, self.questions.filter_data(pages)?))
    }

    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let hits = match header.encoding {
            1 => Hits::All,
            2 => Hits::Closest(header.most_boxes),
            3 => Hits::Any,
            _ => return Err(Reject::Query("hits")),
        };
        let has = |kind: Kind| has(&header.sections, kind.section().0);
        let kind = match [has(Kind::Rays), has(Kind::Spheres)] {
            [true, false] => Kind::Rays,
            [false, true] => Kind::Spheres,
            _ => return Err(Reject::Query("shapes")),
        };
        let (questions, count) = Questions::parse(header, kind.section(), payload_bytes)?;
        let is_right = count == u64::from(header.box_count);
        is_right.then_some(()).ok_or(Reject::Query("object count"))?;
        Ok(Self {
            scene: SceneId(header.scene),
            revision: (header.base != 0).then_some(header.base),
            hits,
            threads: threads_of(header.threads),
            kind,
            count: header.box_count,
            questions,
        })
    }
}

impl RequestHeader {
    /// A cast into a scene.
    pub fn cast_scene(client_token: u64, frame: u64, request: &CastRequest) -> Self {
        let (encoding, most_boxes) = match request.hits {
            Hits::All => (1, 0),
            Hits::Closest(most) => (2, most),
            Hits::Any => (3, 0),
        };
        Self {
            box_count: request.count,
            encoding,
            most_boxes,
            threads: thread_number(request.threads),
            sections: request.questions.slots(),
            scene: request.scene.0,
            base: request.revision.unwrap_or(0),
            ..Self::envelope(Operation::CastScene, client_token, frame)
        }
    }
}

/// The header of an answered cast, whose hits begin the payload.
pub fn response_cast(
    fields: &ReplyFields,
    engine: EngineName,
    threads: usize,
    hits: usize,
    times: &StageTimes,
) -> ResponseHeader {
    let bytes = (hits * HIT_BYTES) as u64;
    ResponseHeader {
        engine: engine as u32,
        threads: u32::try_from(threads).unwrap_or(u32::MAX),
        pair_count: hits as u64,
        stages_ns: stages(times),
        sections: slots([Section::required(SectionKind::Hits, 0, bytes)]),
        ..envelope(fields, StatusCode::Ok)
    }
}

/// A validated response to a cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CastReply {
    /// Engine that answered; it may be one that this build does not know.
    pub engine: EngineId,
    /// Threads that the engine could use.
    pub threads: usize,
    /// Time by stage.
    pub times: StageTimes,
    hits: Section,
}

impl CastReply {
    /// Checks a copied header against the request's fields and the payload's length.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload_bytes: u64,
    ) -> Result<Self, ReplyError> {
        Reply::check_envelope(header, asked)?;
        if header.box_count != asked.box_count.get() {
            return Err(ReplyError::Malformed { field: "box count" });
        }
        let hits = find(&header.sections, SectionKind::Hits, HIT_BYTES as u64, payload_bytes);
        let hits = hits.ok_or(ReplyError::Malformed { field: "hits" })?;
        Ok(Self {
            engine: EngineId::from_wire(header.engine),
            threads: header.threads as usize,
            times: times_of(header),
            hits,
        })
    }

    /// Copies the hits, which another process may write meanwhile, and checks the copy: by query, as many of each as were
    /// asked for, and of boxes whose indices are below `index_end`.
    ///
    /// # Errors
    /// [`ReplyError::Malformed`].
    pub fn read(
        &self,
        pages: &[Page],
        request: &CastRequest,
        index_end: u32,
    ) -> Result<Vec<Hit>, ReplyError> {
        let malformed = ReplyError::Malformed { field: "hits" };
        let hits = self.hits.entries_in::<Hit>(pages).ok_or(malformed)?.to_vec();
        let (most, is_any) = match request.hits {
            Hits::All => (u32::MAX, false),
            Hits::Closest(most) => (most, false),
            Hits::Any => (1, true),
        };
        let mut of_query = 0;
        for (at, hit) in hits.iter().enumerate() {
            let last = at.checked_sub(1).map(|last| hits[last].query);
            of_query = if last == Some(hit.query) { of_query + 1 } else { 1 };
            let is_box = if is_any { hit.index == Hit::ANY } else { hit.index < index_end };
            let is_in_order = last.is_none_or(|last| last <= hit.query);
            if !is_box || !is_in_order || hit.query >= request.count || of_query > most {
                return Err(malformed);
            }
        }
        Ok(hits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Request;
    use pairmask_core::cast::Ray;
    use pairmask_core::filters::FilterData;
    use pairmask_core::sphere::Sphere;
    use pairmask_core::units::BoxCount;

    const PAGE: u64 = size_of::<Page>() as u64;

    fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<CastRequest, Reject> {
        match Request::parse(header, payload_bytes)? {
            Request::CastScene(request) => Ok(request),
            other => panic!("{other:?}"),
        }
    }

    fn pages(bytes: u64) -> Vec<Page> {
        vec![bytemuck::Zeroable::zeroed(); bytes.div_ceil(PAGE) as usize]
    }

    #[test]
    fn what_is_written_is_read() {
        for count in [0, 1, 2, 102, 103, 256] {
            let rays: Vec<Ray> =
                (0..count).map(|i| Ray::new([i as f32; 3], [1.0; 3]).up_to(i as f32)).collect();
            let spheres: Vec<Sphere> =
                (0..count).map(|i| Sphere::new([i as f32; 3], 2.0)).collect();
            let each = vec![FilterData::default(); count];
            for (at, filter_data) in [
                QueryFilterData::None,
                QueryFilterData::One(FilterData::default()),
                QueryFilterData::Each(&each),
            ]
            .into_iter()
            .enumerate()
            {
                let hits = [Hits::All, Hits::Closest(7), Hits::Any][at];
                for shapes in [Shapes::Rays(&rays), Shapes::Spheres(&spheres)] {
                    let revision = [None, Some(7)][count % 2];
                    let sent = CastRequest::new(SceneId(3), revision, shapes, hits, &filter_data)
                        .expect("few");
                    let mut pages = pages(sent.payload_bytes());
                    assert!(sent.write(shapes, &filter_data, &mut pages));
                    let header = RequestHeader::cast_scene(1, 2, &sent);
                    let got = parse(&header, PAGE * pages.len() as u64).expect("right");
                    assert_eq!(got, sent);
                    match (got.read(&pages).expect("all there").0, shapes) {
                        (Shapes::Rays(read), Shapes::Rays(rays)) => assert_eq!(read, rays),
                        (Shapes::Spheres(read), Shapes::Spheres(all)) => assert_eq!(read, all),
                        other => panic!("{other:?}"),
                    }
                    if sent.payload_bytes() > 0 {
                        assert!(parse(&header, sent.payload_bytes() - 1).is_err());
                    }
                    assert!(got.read(&[]).is_none() || sent.payload_bytes() == 0);
                }
            }
        }
    }

    #[test]
    fn forged_casts_are_refused() {
        let rays = [Ray::default(); 5];
        let filter_data = [FilterData::default(); 5];
        let filter_data = QueryFilterData::Each(&filter_data);
        let request =
            CastRequest::new(SceneId(1), None, Shapes::Rays(&rays), Hits::All, &filter_data);
        let right = RequestHeader::cast_scene(1, 2, &request.expect("few"));
        assert!(parse(&right, PAGE).is_ok());
        let forgeries: [&dyn Fn(&mut RequestHeader); 12] = [
            &|h| h.encoding = 0,
            &|h| h.encoding = 4,
            &|h| h.box_count = 4,
            &|h| h.sections[0].bytes += 1,
            &|h| h.sections[0].bytes = u64::MAX - 15,
            &|h| h.sections[0].offset = u64::MAX - 3,
            &|h| h.sections[0].kind = SectionKind::Spheres as u32,
            &|h| h.sections[0].kind = SectionKind::Boxes as u32,
            &|h| h.sections[2] = h.sections[0],
            &|h| h.sections[2] = Section { kind: SectionKind::Spheres as u32, ..h.sections[0] },
            &|h| h.sections[1].bytes = 24,
            &|h| h.sections[1].offset = PAGE,
        ];
        for (number, forge) in forgeries.iter().enumerate() {
            let mut forged = right;
            forge(&mut forged);
            assert!(parse(&forged, PAGE).is_err(), "forgery {number}");
        }
    }

    #[test]
    fn forged_hits_are_refused() {
        let rays = [Ray::default(); 3];
        let request = |hits| {
            let shapes = Shapes::Rays(&rays);
            CastRequest::new(SceneId(1), None, shapes, hits, &QueryFilterData::None).expect("few")
        };
        let fields = ReplyFields { client_token: 1, frame: 2, box_count: BoxCount::new(3) };
        let read = |hits: &[[u32; 2]], asked| {
            let hits: Vec<Hit> = hits
                .iter()
                .map(|[query, index]| Hit { query: *query, index: *index, distance: 1.0 })
                .collect();
            let mut pages = pages(PAGE);
            let bytes: &[u8] = bytemuck::cast_slice(&hits);
            bytemuck::cast_slice_mut(&mut pages)[..bytes.len()].copy_from_slice(bytes);
            let times = StageTimes::default();
            let header = response_cast(&fields, EngineName::CpuTree, 1, hits.len(), &times);
            let reply = CastReply::parse(&header, &fields, PAGE)?;
            reply.read(&pages, &request(asked), 9).map(|read| assert_eq!(read, hits))
        };
        assert_eq!(read(&[[0, 8], [0, 3], [2, 0]], Hits::All), Ok(()));
        assert_eq!(read(&[[0, 8], [2, 0]], Hits::Closest(1)), Ok(()));
        assert_eq!(read(&[[1, Hit::ANY]], Hits::Any), Ok(()));
        for (hits, asked) in [
            (&[[0, 9]][..], Hits::All),
            (&[[3, 0]], Hits::All),
            (&[[1, 0], [0, 0]], Hits::All),
            (&[[1, 0], [1, 1]], Hits::Closest(1)),
            (&[[1, 0]], Hits::Closest(0)),
            (&[[1, 0]], Hits::Any),
            (&[[1, Hit::ANY], [1, Hit::ANY]], Hits::Any),
            (&[[1, Hit::ANY]], Hits::All),
        ] {
            assert!(read(hits, asked).is_err(), "{hits:?} for {asked:?}");
        }
        let times = StageTimes::default();
        let right = response_cast(&fields, EngineName::CpuTree, 1, 5, &times);
        for forge in [
            (|h| h.box_count = 4) as fn(&mut ResponseHeader),
            |h| h.frame = 3,
            |h| h.sections[0].bytes += 1,
            |h| h.sections[0].bytes = PAGE + 8,
            |h| h.sections[0] = Section::default(),
            |h| h.sections[1] = h.sections[0],
        ] {
            let mut forged = right;
            forge(&mut forged);
            assert!(CastReply::parse(&forged, &fields, PAGE).is_err());
        }
    }
}
