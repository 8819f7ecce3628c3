//! Queries, culls between two sets, and shared scenes on the wire: golden bytes of what goes out and what
//! comes back, as WIRE.md has them.

use std::time::Duration;

use pairmask_core::Aabb;
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_core::filters::{FilterData, FilterId, Owner, World};
use pairmask_core::mask::Encoding;
use pairmask_core::precision::BoxForm;
use pairmask_core::scene::shared::{AtEnd, Scope};
use pairmask_core::scene::{
    Edit, QueryFilterData, QueryMask, Report, Scene, SceneOptions, Sets, Step,
};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    AgreedTerms, CullRequest, JoinRequest, LeaseAction, LeaseRequest, Page, QueryRequest,
    ReplyError, ReplyFields, Request, RequestHeader, ResponseHeader, SceneAnswerLayout, SceneId,
    SceneName, SceneRequest, SceneSections, SharedTerms, TickMarks, TickNotes, parse_joined,
    parse_leased, response_joined, response_leased, response_scene,
};

use crate::scenes::{self, written};
use crate::{Bytes, TOKEN, at, pages};

pub const FRAME: u64 = 9;
pub const ASKED: ReplyFields =
    ReplyFields { client_token: TOKEN, frame: FRAME, box_count: BoxCount::new(0) };

/// The kind of a section of late ranges; it is required, which the upper half says.
const LATE_RANGES: u64 = 25;

/// The fields of a request that follow the magic, the version, the token and the frame.
#[derive(Default)]
pub struct Fields {
    pub operation: u32,
    pub boxes: u32,
    pub engine: u32,
    pub encoding: u32,
    pub threads: u32,
    pub sections: Vec<(u32, u64, u64)>,
    pub scene: u32,
    pub base: u64,
    pub revision: u64,
    pub most_boxes: u32,
    pub scene_flags: u32,
}

impl Fields {
    pub fn bytes(&self) -> Vec<u8> {
        let bytes = Bytes::of_magic(b"PMRQ").u32(&[self.operation, 0]).u64(&[TOKEN, FRAME]).u32(&[
            self.boxes,
            self.engine,
            self.encoding,
            self.threads,
        ]);
        let bytes = self.sections.iter().fold(bytes, |bytes, section| bytes.section(*section));
        bytes
            .zeros_to(240)
            .u32(&[0, self.scene])
            .u64(&[self.base, self.revision])
            .u32(&[self.most_boxes, self.scene_flags])
            .0
    }
}

#[test]
fn golden_query() {
    let queries = [at(0.0), at(2.0), at(4.0)];
    let first = FilterData::new(World(-1), Owner(9), FilterId(1)).with_static(true);
    let each = [first, FilterData::default(), first];
    let mask = QueryMask::new(3, 100).unwrap();
    // One entry of filter data for all of the queries begins on a cache line, and so do filter data for each.
    for (filter_data, section, revision) in [
        (QueryFilterData::None, None, Some(7)),
        (QueryFilterData::One(first), Some((23, 128, 12)), Some(u64::MAX)),
        (QueryFilterData::Each(&each), Some((23, 128, 36)), None),
    ] {
        let request = QueryRequest::new(SceneId(5), revision, mask, Encoding::List, &filter_data);
        let header = RequestHeader::query_scene(TOKEN, FRAME, &request);
        let sections = [(1, 0, 72)].into_iter().chain(section).collect();
        let fields = Fields {
            operation: 5,
            boxes: 103,
            encoding: 3,
            sections,
            scene: 5,
            base: revision.unwrap_or(0),
            ..Fields::default()
        };
        assert_eq!(bytemuck::bytes_of(&header), fields.bytes(), "{filter_data:?}");
        let mut payload = pages(request.payload_bytes());
        assert!(request.write(&queries, &filter_data, &mut payload));
        let words: &[u32] = bytemuck::cast_slice(&payload);
        assert_eq!(words[..18], *bytemuck::cast_slice::<Aabb, u32>(&queries));
        if section.is_some() {
            assert_eq!(words[32..35], [u32::MAX, 9, 1 | 1 << 16], "world, owner, filter and flags");
        }
        let parsed = Request::parse(&header, size_of_val(&payload[..]) as u64);
        assert_eq!(parsed, Ok(Request::QueryScene(request)));
        assert_eq!(request.read(&payload), Some((&queries[..], filter_data)));
    }
}

#[test]
fn golden_cull_between() {
    let slot = SceneSections::first(BoxForm::F32, BoxCount::new(100));
    let request = CullRequest { first_set: Some(BoxCount::new(40)), ..CullRequest::of(slot) };
    let header = RequestHeader::cull(TOKEN, FRAME, &request);
    let fields = Fields {
        operation: 6,
        boxes: 100,
        sections: vec![(1, 0, 2400)],
        most_boxes: 40,
        ..Fields::default()
    };
    assert_eq!(bytemuck::bytes_of(&header), fields.bytes());
    assert_eq!(Request::parse(&header, 4096), Ok(Request::Cull(request)));
}

#[test]
fn golden_join() {
    let name: SceneName = "level:3".parse().unwrap();
    let terms = |most_boxes, deadline, at_end| SharedTerms { most_boxes, deadline, at_end };
    let all = terms(Some(1_000), Some(Duration::from_millis(20)), Some(AtEnd::Keep));
    for (terms, scope, engine, expected) in [
        (
            all,
            Scope::All,
            EngineChoice::Only(EngineName::GpuGrid),
            Fields {
                engine: 5,
                base: 20_000_000,
                most_boxes: 1_000,
                scene_flags: 2 | 4,
                ..Fields::default()
            },
        ),
        (
            terms(None, None, Some(AtEnd::Remove)),
            Scope::Own,
            EngineChoice::Auto,
            Fields { scene_flags: 1, ..Fields::default() },
        ),
        (terms(None, None, None), Scope::Own, EngineChoice::Auto, Fields::default()),
    ] {
        let request = JoinRequest { scene: SceneId(5), name: name.section(), terms, scope, engine };
        let header = RequestHeader::join_shared(TOKEN, FRAME, &request);
        let fields = Fields { operation: 7, sections: vec![(24, 0, 7)], scene: 5, ..expected };
        assert_eq!(bytemuck::bytes_of(&header), fields.bytes(), "{terms:?}");
        let mut payload = pages(7);
        assert!(name.write(&mut payload));
        assert!(bytemuck::cast_slice::<Page, u8>(&payload).starts_with(b"level:3\0"));
        assert_eq!(Request::parse(&header, 4096), Ok(Request::JoinShared(request)));
        assert_eq!(SceneName::read(&request, &payload), Some(name.clone()));
    }
}

#[test]
fn golden_lease() {
    for (action, encoding, base, revision) in [
        (LeaseAction::Take { first: 30, count: 4 }, 1, 30, 4),
        (LeaseAction::TakeAny { count: 4 }, 2, 0, 4),
        (LeaseAction::GiveBack { first: 30 }, 3, 30, 0),
    ] {
        let request = LeaseRequest { scene: SceneId(5), action };
        let header = RequestHeader::lease_shared(TOKEN, FRAME, &request);
        let fields =
            Fields { operation: 8, encoding, scene: 5, base, revision, ..Fields::default() };
        assert_eq!(bytemuck::bytes_of(&header), fields.bytes(), "{action:?}");
        assert_eq!(Request::parse(&header, 0), Ok(Request::LeaseShared(request)));
    }
}

#[test]
fn golden_commit_and_leave() {
    let boxes = [at(0.0), at(0.5)];
    let steps = [Step::Set(Sets { indices: (&[9, 4]).into(), boxes: &boxes })];
    let (layout, _) = written(&steps);
    let report = Report::Changes;
    let (engine, threads) = (EngineChoice::Auto, None);
    let request = SceneRequest { report, engine, threads, ..scenes::request(&layout, 0) };
    let header = RequestHeader::commit_shared(TOKEN, FRAME, &request);
    let fields = Fields {
        operation: 9,
        boxes: 2,
        encoding: 1,
        sections: vec![(1, 0, 48), (13, 128, 24), (14, 64, 8)],
        scene: 5,
        base: 6,
        revision: 7,
        scene_flags: 1,
        ..Fields::default()
    };
    assert_eq!(bytemuck::bytes_of(&header), fields.bytes());
    let parsed = Request::parse(&header, layout.payload_bytes().next_multiple_of(64));
    assert_eq!(parsed, Ok(Request::CommitShared(request)));

    let header = RequestHeader::leave_shared(TOKEN, FRAME, SceneId(5));
    let fields = Fields { operation: 10, scene: 5, ..Fields::default() };
    assert_eq!(bytemuck::bytes_of(&header), fields.bytes());
    assert_eq!(Request::parse(&header, 0), Ok(Request::LeaveShared(SceneId(5))));
}

/// Compares the start of a response, its detail, and sections of late ranges by their places.
fn compare(header: &ResponseHeader, flags: u64, detail: [u64; 4], sections: &[(usize, [u64; 2])]) {
    let bytes: &[u8] = bytemuck::bytes_of(header);
    assert_eq!(bytes[..8], *b"PMRS\x01\x00\x0f\x00");
    assert_eq!(
        bytes[8..32],
        *bytemuck::bytes_of(&[flags << 32, TOKEN, FRAME]),
        "status, flags and the echo"
    );
    assert_eq!(bytes[208..240], *bytemuck::bytes_of(&detail));
    for (at, [offset, long]) in sections {
        let expected = [LATE_RANGES + (1 << 32), *offset, *long];
        assert_eq!(bytes[240 + 24 * at..][..24], *bytemuck::bytes_of(&expected));
    }
}

#[test]
fn golden_answers_of_shared_scenes() {
    let deadline = Duration::from_millis(20);
    let terms = AgreedTerms { most_boxes: 1_000, deadline, at_end: AtEnd::Keep };
    let joined = response_joined(&ASKED, &terms);
    compare(&joined, 0, [1_000, 20_000_000, 2, 0], &[]);
    assert_eq!(parse_joined(&joined, &ASKED), Ok(terms));

    let leased = response_leased(&ASKED, &(30..34));
    compare(&leased, 0, [30, 34, 0, 0], &[]);
    assert_eq!(parse_leased(&leased, &ASKED), Ok(30..34));

    // Two boxes that touch: one pair begins, two words, and then the late ranges.
    let mut scene = Scene::new(SceneOptions::default());
    let boxes = [at(0.0), at(0.5)];
    let steps = [Step::Set(Sets { indices: (0..2).into(), boxes: &boxes })];
    let reported = scene.edit(Edit { steps: &steps }, Report::Changes).unwrap();
    let layout = SceneAnswerLayout::of(reported);
    let late = [10..20, 40..41];
    let notes = TickNotes { tick: 77, late: &late, user_data: &[] };
    let marks = TickMarks::after(&layout, &notes);
    let (engine, times) = (EngineName::CpuGrid, StageTimes::default());
    let header = marks.mark(response_scene(&ASKED, engine, 1, reported, 4_096, &times));
    // Its pair count is that of the whole scene.
    compare(&header, 2, [4_096, 77, 0, 0], &[(4, [4 * layout.words(), 16])]);
    let mut words = vec![0; marks.words() as usize];
    marks.write(&notes, &mut words);
    assert_eq!(words[layout.words() as usize..], [10, 20, 40, 41]);
    assert_eq!(TickMarks::parse(&header, 4 * marks.words()), Ok(marks));
    assert_eq!(marks.late_in(&words), late);
    assert_eq!(marks.user_data_in(&words).count(), 0);

    let notes = TickNotes { user_data: &[(9, 7 << 32 | 3), (4, 0)], ..notes };
    let marks = TickMarks::after(&layout, &notes);
    let header = marks.mark(response_scene(&ASKED, engine, 1, reported, 4_096, &times));
    let mut words = vec![0; marks.words() as usize];
    marks.write(&notes, &mut words);
    assert_eq!(words[layout.words() as usize..], [10, 20, 40, 41, 9, 3, 7, 4, 0, 0]);
    let section = header.sections[5];
    // Clients that do not know it pass over it.
    assert_eq!((section.kind, section.flags, section.bytes), (29, 0, 24));
    assert_eq!(TickMarks::parse(&header, 4 * marks.words()), Ok(marks));
    assert!(marks.user_data_in(&words).eq(notes.user_data.iter().copied()));
    let short = TickMarks::parse(&header, 4 * marks.words() - 4);
    assert_eq!(short, Err(ReplyError::Malformed { field: "user data" }));
    assert_eq!(marks.user_data_in(&words[..4]).count(), 0, "nothing beyond the words");
}
