//! Edits of scenes and their answers on the wire: golden bytes, round trips, and arbitrary bytes from the
//! other side.

use pairmask_core::Aabb;
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{EngineChoice, EngineId, EngineName};
use pairmask_core::filters::{Filter, FilterData, FilterId, FilterTable, Owner, World};
use pairmask_core::scene::{
    Edit, EndReason, Ended, FilterDataSets, Indices, Report, Scene, SceneOptions, Sets, Step,
    UserData, UserDataSets,
};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    EditLayout, EditScratch, Page, Reject, ReplyError, ReplyFields, Request, RequestHeader,
    ResponseHeader, SceneAnswerLayout, SceneId, SceneReply, SceneRequest, Section, page_count,
    response_scene, response_scene_ended,
};
use proptest::prelude::*;

use crate::{Bytes, TOKEN, at, forged, pages};

/// The layout of an edit, and its payload.
pub fn written(steps: &[Step<'_>]) -> (EditLayout, Vec<Page>) {
    let layout = EditLayout::of(Edit { steps }).unwrap();
    let mut payload = pages(layout.payload_bytes());
    assert!(layout.write(Edit { steps }, &mut payload));
    (layout, payload)
}

pub fn request(layout: &EditLayout, most_boxes: u32) -> SceneRequest {
    let [boxes, steps, indices] = layout.sections();
    SceneRequest {
        scene: SceneId(5),
        base: 6,
        revision: 7,
        is_acknowledged: true,
        is_lost: false,
        reported: None,
        report: Report::Moved,
        most_boxes,
        engine: EngineChoice::Only(EngineName::GpuGrid),
        threads: Some(3),
        boxes,
        steps,
        indices,
    }
}

/// What a step does to which index; a list may come back as a bitmask.
fn done(steps: &[Step<'_>]) -> Vec<(u8, u64, Option<[u8; 24]>)> {
    let mut done = Vec::new();
    for step in steps {
        let (does, indices, boxes): (u8, &Indices<'_>, &[Aabb]) = match step {
            Step::Remove(indices) => (0, indices, &[]),
            Step::Set(Sets { indices, boxes }) => (1, indices, boxes),
            Step::Enable(indices, on) => (2 + u8::from(*on), indices, &[]),
            Step::Static(indices, on) => (4 + u8::from(*on), indices, &[]),
            _ => unreachable!("no other step"),
        };
        let named: Vec<u64> = match *indices {
            Indices::List(list) => list.iter().map(|i| u64::from(*i)).collect(),
            Indices::Range { first, count } => {
                (0..u64::from(count)).map(|i| u64::from(first) + i).collect()
            }
            Indices::Mask { first, words } => (0..32 * words.len())
                .filter(|bit| words[bit / 32] & (1 << (bit % 32)) != 0)
                .map(|bit| u64::from(first) + bit as u64)
                .collect(),
            _ => unreachable!("no other indices"),
        };
        for (at, index) in named.into_iter().enumerate() {
            let b = boxes.get(at).map(|b| bytemuck::cast(*b));
            done.push((does, index, b));
        }
    }
    done
}

#[test]
fn golden_edit() {
    let boxes = [at(0.0), at(2.0)];
    let steps = [
        Step::Set(Sets { indices: (&[9, 4]).into(), boxes: &boxes }),
        Step::Static((10..13).into(), true),
    ];
    let (layout, payload) = written(&steps);
    let header = RequestHeader::edit_scene(TOKEN, 8, &request(&layout, 100));
    let expected = Bytes::of_magic(b"PMRQ")
        .u32(&[3, 0])
        .u64(&[TOKEN, 8])
        .u32(&[2, 5, 2, 3])
        .section((1, 0, 48))
        .section((13, 128, 48))
        .section((14, 64, 8))
        .zeros_to(240)
        .u32(&[0, 5])
        .u64(&[6, 7])
        .u32(&[100, 1]);
    assert_eq!(bytemuck::bytes_of(&header), expected.0);

    let words: &[u32] = bytemuck::cast_slice(&payload);
    assert_eq!(&words[..12], bytemuck::cast_slice::<Aabb, u32>(&boxes));
    assert_eq!(words[16..18], [9, 4]);
    assert_eq!(words[32..44], [2, 1, 0, 2, 0, 0, 5, 2, 10, 3, 2, 2]);

    let end = RequestHeader::end_scene(TOKEN, 9, SceneId(5));
    assert_eq!((end.operation, end.scene), (4, 5));
    assert_eq!(Request::parse(&end, 4096), Ok(Request::EndScene(SceneId(5))));
}

#[test]
fn an_edit_is_read_as_it_was_written() {
    let boxes: Vec<Aabb> = (0..200).map(|i| at(i as f32)).collect();
    let dense: Vec<u32> = (0..200).map(|i| 3 * i + 7).collect();
    let sparse: Vec<u32> = (0..200).map(|i| 900 * i).collect();
    let falling: Vec<u32> = (0..200).rev().collect();
    let words = [0b1011, 0, u32::MAX];
    let set = |indices| Step::Set(Sets { indices, boxes: &boxes[..indices.len()] });
    let steps = [
        set(Indices::List(&dense)),
        set(Indices::List(&sparse)),
        set(Indices::List(&falling)),
        set((5..60).into()),
        set(Indices::Mask { first: 77, words: &words }),
        set(Indices::List(&[])),
        Step::Remove(Indices::List(&dense)),
        Step::Remove((0..3).into()),
        Step::Enable(Indices::Mask { first: 1, words: &words }, true),
        Step::Enable(Indices::List(&[4]), false),
        Step::Static((8..9).into(), true),
        Step::Static(Indices::List(&sparse), false),
    ];
    for count in 0..=steps.len() {
        let edit = Edit { steps: &steps[..count] };
        let (layout, mut payload) = written(edit.steps);
        let request = request(&layout, 1 << 20);
        let header = RequestHeader::edit_scene(TOKEN, 1, &request);
        let parsed = Request::parse(&header, size_of_val(&payload[..]) as u64).unwrap();
        assert_eq!(parsed, Request::EditScene(request));
        let mut scratch = EditScratch::default();
        let read = scratch.read(&request, &payload).unwrap();
        assert_eq!(done(&read), done(edit.steps));
        if count > 0 {
            let short = &mut payload[..page_count(layout.payload_bytes()) as usize - 1];
            assert!(!layout.write(edit, short), "too few pages");
        }
    }
    // 200 indices in 600 take 19 words as a bitmask.
    let layout = EditLayout::of(Edit { steps: &steps[..1] }).unwrap();
    assert_eq!(layout.sections()[2].bytes, 4 * 19);
}

/// Filters as a scene may have them.
fn table() -> FilterTable {
    let one = Filter::new(1 << 40 | 2, 3).with_group(-7).with_static(true);
    FilterTable::new(&[one, Filter::ALL.with_either(true)]).unwrap()
}

#[test]
fn golden_rules() {
    let table = table();
    let filter_data = [
        FilterData::new(World(-1), Owner(9), FilterId(1)).with_static(true),
        FilterData::default(),
    ];
    let steps = [
        Step::FilterData(FilterDataSets { indices: (&[9, 4]).into(), filter_data: &filter_data }),
        Step::Filters(&table),
        Step::Include(&[[1, 2]], true),
        Step::Exclude(&[[5, 3]], false),
    ];
    let (layout, payload) = written(&steps);
    let words: &[u32] = bytemuck::cast_slice(&payload);
    let all = u32::MAX;
    let expected = [
        // The indices of the filter data, and the filter data.
        &[9, 4, all, 9, 1 | 1 << 16, 0, 0, 0][..],
        // The filters.
        &[1, (-7i32).cast_unsigned(), 2, 1 << 8, 3, 0, 2, 0, all, all, all, all],
        // Pairs of both lists.
        &[1, 2, 5, 3],
    ]
    .concat();
    assert_eq!(&words[..24], expected);
    // The records begin on the next line.
    let records =
        [[7, 1, 0, 2, 0, 2], [8, 0, 0, 2, 8, 8], [9, 0, 0, 1, 20, 20], [12, 0, 0, 1, 22, 22]];
    assert_eq!(&words[32..56], records.concat());
    let mut scratch = EditScratch::default();
    let read = scratch.read(&request(&layout, 10), &payload).unwrap();
    assert_eq!(format!("{read:?}"), format!("{steps:?}"));
}

#[test]
fn golden_user_data() {
    let user_data = [7u64, 1 << 40 | 2].map(UserData::from);
    let marked = Step::UserData(UserDataSets { indices: (3..5).into(), user_data: &user_data });
    let (layout, payload) = written(&[marked]);
    let words: &[u32] = bytemuck::cast_slice(&payload);
    assert_eq!(words[..4], [7, 0, 2, 1 << 8]);
    assert_eq!(words[16..22], [13, 2, 3, 2, 0, 0]);
    let mut scratch = EditScratch::default();
    let read = scratch.read(&request(&layout, 10), &payload).unwrap();
    assert_eq!(format!("{read:?}"), format!("{:?}", [marked]));
    assert_eq!(user_data.map(u64::from), [7, 1 << 40 | 2]);
}

#[test]
fn pairs_that_count_as_reported_are_said_in_the_header() {
    let layout = EditLayout::of(Edit::NONE).unwrap();
    let request = |reported| SceneRequest { reported, ..request(&layout, 10) };
    for reported in [None, Some(0), Some(7 << 32 | 5), Some((1 << 63) - 1)] {
        let header = RequestHeader::edit_scene(TOKEN, 1, &request(reported));
        let count = reported.unwrap_or(0);
        assert_eq!([header.flags, header.iterate_threads], [count as u32, (count >> 32) as u32]);
        assert_eq!(header.scene_flags & 4 != 0, reported.is_some());
        let parsed = Request::parse(&header, 4096);
        assert_eq!(parsed, Ok(Request::EditScene(request(reported))));
    }
    for count in [1 << 63, u64::MAX] {
        let header = RequestHeader::edit_scene(TOKEN, 1, &request(Some(count)));
        let refused = Err(Reject::Edit("reported pairs"));
        assert_eq!(Request::parse(&header, 4096), refused, "more than any scene has");
    }
}

#[test]
fn forged_rules_are_refused() {
    let table = table();
    let (layout, payload) = written(&[Step::Filters(&table), Step::Filters(&table)]);
    let mut scratch = EditScratch::default();
    let refused = scratch.read(&request(&layout, 10), &payload).map(drop);
    assert_eq!(refused, Err(Reject::Edit("filters")));

    let filter_data = [FilterData::default(); 3];
    let steps = [
        Step::FilterData(FilterDataSets { indices: (0..3).into(), filter_data: &filter_data }),
        Step::Include(&[[0, 1]], true),
        Step::Filters(&table),
    ];
    for (number, step) in steps.iter().enumerate() {
        let (layout, payload) = written(std::slice::from_ref(step));
        let request = request(&layout, 10);
        for (word, value) in [(3, u32::MAX), (5, 1 << 30), (5, u32::MAX), (0, 14), (0, 0), (3, 70)]
        {
            let mut payload = payload.clone();
            let records = (request.steps.offset / 4) as usize;
            bytemuck::cast_slice_mut::<_, u32>(&mut payload)[records + word] = value;
            let mut scratch = EditScratch::default();
            let refused = scratch.read(&request, &payload).map(drop);
            assert!(matches!(refused, Err(Reject::Edit(_))), "{number} {word} {value}");
        }
    }
}

/// Each record of an edit that shares what it names would make it work once more, for its 24 bytes.
#[test]
fn steps_that_share_words_or_boxes_are_refused() {
    let (boxes, filter_data) = ([at(0.0); 2], [FilterData::default(); 2]);
    let all: [&dyn Fn() -> Step<'static>; 3] = [
        &|| Step::Include(&[[0, 1], [1, 2]], true),
        &|| Step::Remove(Indices::Mask { first: 0, words: &[1, 0, 0, 0] }),
        &|| Step::Remove(Indices::List(&[3, 1])),
    ];
    let sets = Step::Set(Sets { indices: (0..2).into(), boxes: &boxes });
    let given = FilterDataSets { indices: (0..2).into(), filter_data: &filter_data };
    let steps = all.iter().map(|step| step()).chain([sets, Step::FilterData(given)]);
    for (number, step) in steps.enumerate() {
        let (layout, mut payload) = written(&[step, step]);
        let request = request(&layout, 10);
        let read = |payload| EditScratch::default().read(&request, payload).map(|read| read.len());
        assert_eq!(read(&payload), Ok(2), "{number}");
        let [boxes, steps, indices] = layout.sections();
        let (records, payload_words) = ((steps.offset / 4) as usize, &mut payload);
        let words: &mut [u32] = bytemuck::cast_slice_mut(payload_words);
        words.copy_within(records..records + 6, records + 6);
        let half = |section: Section| Section { bytes: section.bytes / 2, ..section };
        let request = SceneRequest { boxes: half(boxes), indices: half(indices), ..request };
        let refused = EditScratch::default().read(&request, &payload).map(drop);
        assert!(matches!(refused, Err(Reject::Edit(_))), "{number}: {refused:?}");
    }
}

#[test]
fn forged_edits_are_refused() {
    let boxes = [at(0.0), at(0.5)];
    let steps = [Step::Set(Sets { indices: (&[1, 0]).into(), boxes: &boxes })];
    let (layout, payload) = written(&steps);
    let right = RequestHeader::edit_scene(TOKEN, 1, &request(&layout, 10));
    let parse = |header: &RequestHeader| Request::parse(header, 4096);
    assert!(parse(&right).is_ok());
    for change in [
        (|h| h.encoding = 0) as fn(&mut RequestHeader),
        |h| h.encoding = 5,
        |h| h.revision = 0,
        |h| h.revision = h.base,
        |h| h.box_count = 3,
        |h| h.sections[0].bytes += 1,
        |h| h.sections[0].kind = 0,
        |h| h.sections[0].offset = 4090,
        |h| h.sections[1].bytes = 23,
        |h| h.sections[1].offset = u64::MAX - 3,
        |h| h.sections[1] = h.sections[2],
        |h| h.sections[2].offset = 2,
        |h| h.sections[2].bytes = 1 << 40,
        |h| h.sections[3] = h.sections[2],
    ] {
        let refused = parse(&forged(right, change));
        assert!(matches!(refused, Err(Reject::Edit(_))), "{refused:?}");
    }
    let unknown = Section { kind: 2, flags: Section::REQUIRED, offset: 0, bytes: 4 };
    let header = forged(right, |h| h.sections[4] = unknown);
    assert_eq!(parse(&header), Err(Reject::UnknownSection(2)));
    let cull = parse(&forged(right, |h| h.operation = 1));
    assert_eq!(cull, Err(Reject::UnknownSection(13)), "not in a cull");

    // Records that reach beyond what there is.
    let request = request(&layout, 10);
    let record = layout.sections()[1].offset as usize / 4;
    let is_refused = |slot: usize, value: u32| {
        let mut payload = payload.clone();
        bytemuck::cast_slice_mut::<Page, u32>(&mut payload)[record + slot] = value;
        EditScratch::default().read(&request, &payload).map(|steps| done(&steps)).is_err()
    };
    let (long, last) = (1 << 31, u32::MAX);
    let of_fields: [(usize, &[u32]); 5] =
        [(0, &[0, 7]), (1, &[0, 4]), (3, &[3, long]), (4, &[1, last]), (5, &[1, last])];
    let fields = of_fields.iter().flat_map(|(slot, values)| values.iter().map(|v| (*slot, *v)));
    for (slot, value) in fields {
        assert!(is_refused(slot, value), "field {slot} as {value}");
    }
    assert!(!is_refused(2, 7), "a list has no first index");
    // More indices than any edit of such a scene names.
    let (layout, payload) = written(&[Step::Remove((0..161).into())]);
    let [boxes, steps, indices] = layout.sections();
    let few = SceneRequest { boxes, steps, indices, ..request };
    assert!(EditScratch::default().read(&few, &payload).is_err());
    let enough = SceneRequest { most_boxes: 11, ..few };
    assert!(EditScratch::default().read(&enough, &payload).is_ok());
}

const ASKED: ReplyFields = ReplyFields { client_token: 3, frame: 4, box_count: BoxCount::new(2) };

/// A scene that has reported of pairs that began and ended, and its answer.
fn answer(report: Report) -> (Scene, ResponseHeader, Vec<u32>) {
    let mut scene = Scene::new(SceneOptions::default());
    let row: Vec<Aabb> = (0..6).map(|i| at(0.7 * i as f32)).collect();
    let all = [Step::Set(Sets { indices: (0..6).into(), boxes: &row })];
    scene.edit(Edit { steps: &all }, Report::Changes).unwrap();
    scene.acknowledge();
    let steps = [
        Step::Set(Sets { indices: (0..1).into(), boxes: &row[3..4] }),
        Step::Remove((5..6).into()),
        Step::Enable((1..2).into(), false),
    ];
    scene.edit(Edit { steps: &steps }, report).unwrap();
    let layout = SceneAnswerLayout::of(scene.reported());
    let mut words = vec![u32::MAX; layout.words() as usize];
    layout.write(scene.reported(), &mut words);
    let times = StageTimes { total_ns: 9, ..StageTimes::default() };
    let header = response_scene(&ASKED, EngineName::CpuGrid, 2, scene.reported(), 77, &times);
    (scene, header, words)
}

#[test]
fn an_answer_is_read_as_it_was_written() {
    for report in [Report::Changes, Report::Moved, Report::All, Report::Nothing] {
        let (scene, header, words) = answer(report);
        let reported = scene.reported();
        let reply = SceneReply::parse(&header, &ASKED, 4 * words.len() as u64).unwrap();
        assert_eq!(reply.engine, EngineId::Known(EngineName::CpuGrid));
        assert_eq!((reply.threads, reply.scene_bytes, reply.total_ns), (2, 77, 9));
        assert_eq!(
            (reply.is_resync, reply.pair_count),
            (reported.is_resync(), reported.pair_count())
        );
        assert_eq!(&reply.skipped, reported.skipped());
        let layout = reply.layout;
        assert_eq!(SceneAnswerLayout::pairs_in(&layout.begun, &words), reported.begun());
        assert_eq!(SceneAnswerLayout::pairs_in(&layout.pairs, &words), reported.pairs());
        assert!(layout.ended_in(&words, 6).eq(reported.ended().iter().copied()));
        if report == Report::Changes {
            assert!(!reported.begun().is_empty() && reported.ended().len() == 3);
            let below = layout.ended_in(&words, 5).count();
            assert!(below < 3, "indices that the scene does not have are passed over");
        }
    }
    let (_, header, words) = answer(Report::Changes);
    for change in [
        (|h| h.sections[0].bytes -= 4) as fn(&mut ResponseHeader),
        |h| h.sections[0].kind = 0,
        |h| h.sections[1].bytes = 1 << 40,
        |h| h.sections[1].bytes -= 8,
        |h| h.sections[2].bytes += 1,
        |h| h.sections[2].offset = 1 << 20,
        |h| h.sections[3].offset = u64::MAX - 3,
        |h| h.sections[4] = h.sections[0],
    ] {
        let refused = SceneReply::parse(&forged(header, change), &ASKED, 4 * words.len() as u64);
        assert!(matches!(refused, Err(ReplyError::Malformed { .. })), "{refused:?}");
    }
    let other = ReplyFields { frame: 5, ..ASKED };
    assert!(SceneReply::parse(&header, &other, 1 << 20).is_err());
    let ended = response_scene_ended(&ASKED);
    assert_eq!((ended.status, ended.frame), (0, 4));
}

#[test]
fn reasons_that_are_unknown_are_passed_over() {
    let (_, header, mut words) = answer(Report::Changes);
    let reply = SceneReply::parse(&header, &ASKED, 4 * words.len() as u64).unwrap();
    let start = reply.layout.reasons.start as usize;
    let before: Vec<Ended> = reply.layout.ended_in(&words, 6).collect();
    bytemuck::cast_slice_mut::<u32, u8>(&mut words[start..])[0] = 200;
    let after: Vec<Ended> = reply.layout.ended_in(&words, 6).collect();
    assert_eq!(after, before[1..]);
    assert!(before.iter().any(|ended| ended.reason == EndReason::Filtered));
}

proptest! {
    /// Regardless of what a client writes, an edit is refused, or names only what is there.
    #[test]
    fn arbitrary_records_are_refused_or_stay_within_the_payload(
        seed in proptest::collection::vec(any::<u32>(), 64),
        small in proptest::collection::vec(0u32..14, 64),
        choose in proptest::collection::vec(any::<bool>(), 64),
        most_boxes in 0u32..200,
        records in 0u64..5,
        words in 0u64..40,
        boxes in 0u64..8,
    ) {
        let mut payload = pages(4096);
        let all: &mut [u32] = bytemuck::cast_slice_mut(&mut payload);
        for (i, to) in all.iter_mut().enumerate() {
            let (k, large) = (i % 64, choose[i % 64] && choose[(i / 64) % 64]);
            *to = if large { seed[k] } else { small[k] };
        }
        let section = |kind, offset, bytes| Section { kind, flags: 1, offset, bytes };
        let layout = EditLayout::of(Edit::NONE).unwrap();
        let request = SceneRequest {
            boxes: section(1, 0, 24 * boxes),
            steps: section(13, 1024, 24 * records),
            indices: section(14, 2048, 4 * words),
            ..request(&layout, most_boxes)
        };
        let header = RequestHeader::edit_scene(TOKEN, 1, &request);
        prop_assert_eq!(Request::parse(&header, 4096), Ok(Request::EditScene(request)));
        let mut scratch = EditScratch::default();
        if let Ok(steps) = scratch.read(&request, &payload) {
            let named: usize = steps.iter().map(|step| match step {
                Step::Set(Sets { indices, boxes }) => {
                    assert_eq!(indices.len(), boxes.len());
                    indices.len()
                }
                Step::Remove(i) | Step::Enable(i, _) | Step::Static(i, _) => i.len(),
                Step::FilterData(FilterDataSets { indices, filter_data }) => {
                    assert_eq!(indices.len(), filter_data.len());
                    indices.len()
                }
                Step::UserData(UserDataSets { indices, user_data }) => {
                    assert_eq!(indices.len(), user_data.len());
                    indices.len()
                }
                _ => 0,
            }).sum();
            prop_assert!(named <= 16 * most_boxes as usize);
            let options = SceneOptions::default().with_most_boxes(most_boxes).with_threads(1);
            let mut scene = Scene::new(options);
            for _ in 0..2 {
                let _ = scene.edit(Edit { steps: &steps }, Report::Changes).map(drop);
            }
        }
    }
}
