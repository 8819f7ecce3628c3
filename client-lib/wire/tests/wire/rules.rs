//! Rules of frames: golden bytes, round trips, and arbitrary bytes from the other side.
// Rules are filled as users fill them.
#![allow(clippy::field_reassign_with_default)]

use std::sync::Arc;

use bytemuck::{cast_slice, cast_slice_mut};
use pairmask_core::dispatch::{StageTimes, WorldRange};
use pairmask_core::engine::{Census, CullReport, EngineName, EngineTimes};
use pairmask_core::filters::{Filter, FilterData, FilterId, FilterTable, Owner, Rules, World};
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CullRequest, Page, Reject, Reply, ReplyError, ReplyFields, Request, RequestHeader,
    ResponseHeader, RulesLayout, RulesReader, SceneSections, Section, SectionKind, SentRules,
    WORLD_RANGE_WORDS, response_ok, world_ranges_in, write_world_ranges,
};
use proptest::prelude::*;

use crate::{forged, pages};

const N: BoxCount = BoxCount::new(20);

fn rules() -> Rules {
    let mut rules = Rules::default();
    rules.table = FilterTable::new(&[
        Filter::new(0x1_0000_0002, 3).with_group(-4),
        Filter::new(4, u64::MAX).with_static(true).with_either(true),
    ])
    .unwrap();
    rules.filter_data = vec![FilterData::default(); 2];
    rules.filter_data[1] = FilterData::new(World(-7), Owner(9), FilterId(1)).with_static(true);
    rules.lists.include([5, 3], true);
    rules.lists.exclude([0, 19], true);
    rules
}

/// A request with rules behind boxes, and its payload.
fn sent(rules: &Rules, n: BoxCount, form: BoxForm) -> (RequestHeader, Vec<Page>) {
    let scene = SceneSections::first(form, n);
    let layout = RulesLayout::of(rules, n, scene.payload_bytes()).unwrap();
    let mut pages = pages(layout.payload_bytes());
    assert!(layout.write(rules, &mut pages));
    let request = CullRequest { rules: Some(layout.sections()), ..CullRequest::of(scene) };
    (RequestHeader::cull(1, 2, &request), pages)
}

/// What a daemon makes of a request.
fn received(
    header: &RequestHeader,
    pages: &[Page],
    reader: &mut RulesReader,
) -> Result<Arc<SentRules>, Reject> {
    let Request::Cull(request) = Request::parse(header, size_of_val(pages) as u64)? else {
        panic!("a cull")
    };
    let position = request.rules.expect("rules");
    reader.read(&position, request.scene.count, pages).map(Arc::clone)
}

fn is_same(a: &Rules, b: &Rules, n: BoxCount) -> bool {
    (0..n.get()).all(|i| {
        a.filter_data(i) == b.filter_data(i) && (0..i).all(|j| a.meet(i, j) == b.meet(i, j))
    })
}

#[test]
fn golden_rules() {
    let (header, pages) = sent(&rules(), N, BoxForm::F32);
    // 20 boxes are 480 bytes: the parts begin on lines of 64.
    let expected =
        [(1, 0, 480), (18, 512, 24), (19, 576, 48), (20, 640, 8), (21, 704, 8), (0, 0, 0)];
    let sections: Vec<(u32, u64, u64)> =
        header.sections[..6].iter().map(|s| (s.kind, s.offset, s.bytes)).collect();
    assert_eq!(sections, expected);
    assert!(header.sections[1..5].iter().all(|section| section.flags == Section::REQUIRED));
    let words: &[u32] = cast_slice(&pages);
    // World, owner, and filter with the flag of a static box above it.
    assert_eq!(words[128..134], [0, 0, 0, (-7i32).cast_unsigned(), 9, 1 | 1 << 16]);
    let (low, high) = (4, u32::MAX);
    assert_eq!(words[144..150], [0, (-4i32).cast_unsigned(), 2, 1, 3, 0]);
    assert_eq!(words[150..156], [3, 0, low, 0, high, high]);
    assert_eq!((&words[160..162], &words[176..178]), (&[3, 5][..], &[0, 19][..]));
}

#[test]
fn rules_are_read_as_they_were_written_and_known_again() {
    let mut reader = RulesReader::default();
    let mut rules = rules();
    // Beyond the boxes: not sent.
    rules.lists.exclude([4, 20], true);
    for form in BoxForm::ALL {
        let (header, pages) = sent(&rules, N, form);
        let first = received(&header, &pages, &mut reader).unwrap();
        assert!(is_same(first.rules(), &rules, N));
        assert!(!first.let_all_meet());
        assert_eq!((first.most_worlds(), first.number()), (9, 1));
        let again = received(&header, &pages, &mut reader).unwrap();
        assert!(Arc::ptr_eq(&first, &again));
    }
    // Any change makes them others, and leaves holders of the first ones alone.
    let (header, pages) = sent(&rules, N, BoxForm::F32);
    let first = received(&header, &pages, &mut reader).unwrap();
    let mut numbers = vec![first.number()];
    let changes: [fn(&mut Rules); 5] = [
        |rules| rules.filter_data[0].owner = Owner(1),
        |rules| rules.table = FilterTable::new(&[Filter::new(1, 1)]).unwrap(),
        |rules| assert!(rules.lists.include([5, 3], false)),
        |rules| assert!(rules.lists.exclude([0, 18], true)),
        |rules| rules.filter_data.clear(),
    ];
    for change in changes {
        change(&mut rules);
        let (header, pages) = sent(&rules, N, BoxForm::F32);
        let changed = received(&header, &pages, &mut reader).unwrap();
        assert!(is_same(changed.rules(), &rules, N));
        numbers.push(changed.number());
    }
    let fewer = BoxCount::new(19);
    let (header, pages) = sent(&rules, fewer, BoxForm::F32);
    numbers.push(received(&header, &pages, &mut reader).unwrap().number());
    assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
    assert_eq!(first.rules().filter_data(1).world, World(-7));
    reader.give_back();
    assert!(received(&header, &pages, &mut reader).unwrap().number() > numbers[6]);
}

#[test]
fn worlds_and_rules_that_let_all_meet_are_seen() {
    let of_worlds = |worlds: &[i32]| {
        let mut rules = Rules::default();
        rules.filter_data =
            worlds.iter().map(|world| FilterData::default().with_world(World(*world))).collect();
        let n = BoxCount::new(worlds.len() as u32);
        let (header, pages) = sent(&rules, n, BoxForm::F32);
        let sent = received(&header, &pages, &mut RulesReader::default()).unwrap();
        (sent.let_all_meet(), sent.most_worlds())
    };
    assert_eq!(of_worlds(&[5, 5, -1]), (true, 0));
    assert_eq!(of_worlds(&[-1, -1]), (true, 0));
    assert_eq!(of_worlds(&[5, 6, 5, 5]), (false, 3));
    assert_eq!(of_worlds(&[i32::MIN, i32::MAX, -1, 0]), (false, 4));
}

#[test]
fn forged_rules_are_refused() {
    let (header, pages) = sent(&rules(), N, BoxForm::F32);
    let payload_bytes = size_of_val(&pages[..]) as u64;
    let refused = |header: &RequestHeader| {
        matches!(Request::parse(header, payload_bytes), Err(Reject::Rules(_)))
    };
    assert!(!refused(&header));
    for slot in 1..5 {
        for change in [
            (|section| section.offset = u64::MAX - 3) as fn(&mut Section),
            |section| section.offset = 4_096,
            |section| section.offset += 2,
            |section| section.bytes += 4,
            |section| section.bytes = u64::MAX,
        ] {
            assert!(refused(&forged(header, |h| change(&mut h.sections[slot]))), "{slot}");
        }
        assert!(refused(&forged(header, |h| h.sections[6] = h.sections[slot])), "{slot}");
    }
    // More filter data than boxes, more filters than ids, more pairs than may be named.
    for (slot, bytes) in [(1, 12 * 21), (2, 24 * 65_537), (3, 8 * 65_857), (4, 8 * 65_857)] {
        let header = forged(header, |h| h.sections[slot].bytes = bytes);
        assert!(matches!(Request::parse(&header, 1 << 30), Err(Reject::Rules(_))), "{slot}");
    }
    let many = forged(header, |h| {
        (h.sections[3].bytes, h.sections[4].bytes) = (8 * 65_000, 8 * 1_000);
    });
    assert!(matches!(Request::parse(&many, 1 << 30), Err(Reject::Rules(_))));

    let kind = SectionKind::of(ObjectForm::Spheres) as u32;
    assert!(refused(&forged(header, |h| {
        (h.sections[0].kind, h.sections[0].bytes) = (kind, 320);
    })));
    let status = forged(RequestHeader::status(1, 2), |h| h.sections[0] = header.sections[1]);
    assert!(matches!(Request::parse(&status, payload_bytes), Err(Reject::UnknownSection(_))));

    // An index that is not of the frame, in either list; the next rules are read all the same.
    let mut reader = RulesReader::default();
    for word in [160, 161, 176, 177] {
        let mut forged = pages.clone();
        cast_slice_mut::<Page, u32>(&mut forged)[word] = 20;
        assert!(matches!(received(&header, &forged, &mut reader), Err(Reject::Rules(_))));
        let read = received(&header, &pages, &mut reader).unwrap();
        assert!(is_same(read.rules(), &rules(), N));
    }
}

#[test]
fn rules_are_kept_under_the_number_of_their_client() {
    let (header, pages) = sent(&rules(), N, BoxForm::F32);
    let payload_bytes = size_of_val(&pages[..]) as u64;
    let Ok(Request::Cull(with_rules)) = Request::parse(&header, payload_bytes) else {
        panic!("a cull");
    };
    let position = with_rules.rules.unwrap();
    let mut reader = RulesReader::default();
    assert_eq!(reader.named(0, N).unwrap_err(), Reject::UnknownRules);
    reader.read_named(&position, 7, N, &pages).unwrap();
    assert!(is_same(reader.named(7, N).unwrap().rules(), &rules(), N));
    assert_eq!(reader.named(8, N).unwrap_err(), Reject::UnknownRules);
    assert_eq!(reader.named(0, N).unwrap_err(), Reject::UnknownRules);
    let fewer = BoxCount::new(N.get() - 1);
    assert_eq!(reader.named(7, fewer).unwrap_err(), Reject::UnknownRules);
    reader.read(&position, N, &pages).unwrap();
    assert_eq!(reader.named(7, N).unwrap_err(), Reject::UnknownRules, "sent without a number");
    reader.read_named(&position, 9, N, &pages).unwrap();
    reader.give_back();
    assert_eq!(reader.named(9, N).unwrap_err(), Reject::UnknownRules);
    assert_eq!(Reject::UnknownRules.status() as u32, 13);

    let named = CullRequest { rules: None, rules_number: 7, ..with_rules };
    let header = RequestHeader::cull(1, 2, &named);
    assert_eq!(header.sections[1], Section::required(SectionKind::CachedRules, 0, 0));
    assert_eq!(header.revision, 7);
    assert_eq!(Request::parse(&header, payload_bytes), Ok(Request::Cull(named)));
    let refused = |change: &dyn Fn(&mut RequestHeader)| {
        Request::parse(&forged(header, change), payload_bytes).unwrap_err()
    };
    let number = Reject::Rules("number");
    assert_eq!(refused(&|header| header.revision = 0), number);
    let both = RequestHeader::cull(1, 2, &with_rules);
    assert_eq!(refused(&|header| header.sections[2] = both.sections[1]), number);
    let numbered = CullRequest { rules_number: 7, ..with_rules };
    let header = RequestHeader::cull(1, 2, &numbered);
    assert_eq!(Request::parse(&header, payload_bytes), Ok(Request::Cull(numbered)));
}

fn answer(pairs: u64) -> (ResponseHeader, MaskShape) {
    let shape = MaskShape::list(pairs);
    let (census, times) = (Census::default(), EngineTimes::default());
    let report = CullReport::new(N, shape, census, pairs, 0, times);
    let fields = ReplyFields { client_token: 1, frame: 2, box_count: N };
    let stages = StageTimes::default();
    (response_ok(&fields, EngineName::CpuGrid, 1, &report, &stages), shape)
}

#[test]
fn world_ranges_are_read_as_they_were_written_and_forged_ones_are_refused() {
    let ranges = [
        WorldRange::new(World(-9), 0..2),
        WorldRange::new(World(-1), 2..2),
        WorldRange::new(World(4), 2..5),
    ];
    let (mut header, shape) = answer(5);
    let mut words = vec![0; 32];
    assert_eq!(world_ranges_in(&header, &shape, &words).unwrap(), []);
    write_world_ranges(&ranges, &mut words[10..10 + WORLD_RANGE_WORDS * 3]);
    assert_eq!(words[10..13], [(-9i32).cast_unsigned(), 2, 0]);
    header.put_world_ranges(Span { start: 10, len: 9 });
    assert_eq!(header.sections[1], Section::required(SectionKind::WorldRanges, 40, 36));
    assert_eq!(world_ranges_in(&header, &shape, &words).unwrap(), ranges);
    let fields = ReplyFields { client_token: 1, frame: 2, box_count: N };
    Reply::parse(&header, &fields, 128).unwrap();

    let refused = |header: &ResponseHeader, shape: &MaskShape, words: &[u32]| {
        let read = world_ranges_in(header, shape, words);
        matches!(read, Err(ReplyError::Malformed { field: "world ranges" }))
    };
    assert!(refused(&header, &MaskShape::dense(N), &words));
    assert!(refused(&header, &MaskShape::list(4), &words));
    assert!(refused(&header, &MaskShape::list(6), &words));
    assert!(refused(&header, &shape, &words[..18]));
    for (word, value) in [(10, 4), (13, 4), (11, 3), (12, 1), (18, u32::MAX)] {
        let mut words = words.clone();
        words[word] = value;
        assert!(refused(&header, &shape, &words), "{word}");
    }
    for (offset, bytes) in [(u64::MAX - 3, 36), (42, 36), (40, 32), (40, 1 << 40), (40, 24)] {
        let header = forged(header, |h| {
            (h.sections[1].offset, h.sections[1].bytes) = (offset, bytes);
        });
        assert!(refused(&header, &shape, &words), "{offset} {bytes}");
    }
    let doubled = forged(header, |h| h.put_world_ranges(Span { start: 10, len: 9 }));
    assert!(refused(&doubled, &shape, &words));
}

proptest! {
    /// Regardless of what a request holds, it is refused or its rules decide of every pair of its boxes.
    #[test]
    fn any_rules_are_refused_or_read(
        in_header in prop::collection::vec((8usize..68, any::<u32>(), 0u32..32), 0..4),
        in_payload in prop::collection::vec((0usize..300, any::<u32>(), 0u32..32), 0..12),
        cut in 0usize..2,
    ) {
        let (mut header, mut pages) = sent(&rules(), N, BoxForm::F16);
        let words: &mut [u32] = cast_slice_mut(bytemuck::bytes_of_mut(&mut header));
        for (position, value, shift) in in_header {
            words[position] = value >> shift;
        }
        let words: &mut [u32] = cast_slice_mut(&mut pages);
        for (position, value, shift) in in_payload {
            words[position] = value >> shift;
        }
        pages.truncate(pages.len() - cut);
        let mut reader = RulesReader::default();
        if let Ok(Request::Cull(request)) = Request::parse(&header, size_of_val(&pages[..]) as u64)
            && let Some(position) = request.rules
        {
            let n = request.scene.count;
            prop_assert!(n.get() < 1 << 20);
            if let Ok(sent) = reader.read(&position, n, &pages) {
                prop_assert!(sent.rules().filter_data.len() <= n.len());
                let listed = sent.rules().lists.included().chain(sent.rules().lists.excluded());
                prop_assert!(listed.flatten().all(|index| index < n.get()));
                prop_assert!(sent.most_worlds() <= u64::from(n.get()));
                for a in 0..n.get().min(20) {
                    for b in 0..a {
                        let _ = sent.rules().meet(a, b);
                    }
                }
            }
        }
    }

    /// Regardless of what a response holds, its ranges stand side by side in the list, or it is refused.
    #[test]
    fn any_world_ranges_are_refused_or_side_by_side(
        section in (any::<u32>(), any::<u64>(), any::<u64>(), 0u32..64),
        words in prop::collection::vec(0u32..4, 0..40),
        pairs in 0u64..12,
    ) {
        let (mut header, shape) = answer(pairs);
        let (kind, offset, bytes, shift) = section;
        header.put_world_ranges(Span { start: 0, len: words.len() as u64 / 3 * 3 });
        if shift < 32 {
            header.sections[1] = Section {
                kind: if shift < 16 { kind } else { SectionKind::WorldRanges as u32 },
                flags: 0,
                offset: offset >> (2 * shift),
                bytes: bytes >> (2 * shift),
            };
        }
        if let Ok(ranges) = world_ranges_in(&header, &shape, &words) {
            let mut end = 0;
            for range in &ranges {
                prop_assert_eq!(range.pairs.start, end);
                end = range.pairs.end;
            }
            prop_assert!(ranges.is_empty() || end as u64 == pairs);
            prop_assert!(ranges.is_sorted_by(|a, b| a.world < b.world));
        }
    }
}
