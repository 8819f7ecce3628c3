//! An answer: its header, then its payload. The header's first bytes say which question it answers.

use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::mask::{MaskShape, MaskView};
use pairmask_core::scene::QueryFilterData;
use pairmask_wire::{
    CastReply, CastRequest, ObserveReply, PAGE_BYTES, Page, Reply, ReplyFields, ResponseHeader,
    SceneAnswerLayout, SceneId, SceneReply, StatusBody, TermsDiffer, TickMarks, lease_error,
    not_leased, parse_joined, parse_leased, words_in, world_ranges_in,
};

use crate::input::pages_of;
use crate::masks;

/// Boxes up to which a mask is decoded in all ways: by the naive decoder too, which looks at each pair.
const FEW_BOXES: u32 = 200;
/// Indices of the scene that is asked.
const INDEX_END: u32 = 1_000;

pub fn decode(data: &[u8]) {
    let Some((header, payload)) = data.split_at_checked(size_of::<ResponseHeader>()) else {
        return;
    };
    let header: ResponseHeader = bytemuck::pod_read_unaligned(header);
    let pages = pages_of(payload);
    let payload_bytes = (pages.len() * PAGE_BYTES) as u64;
    let asked = ReplyFields {
        client_token: header.client_token,
        frame: header.frame,
        box_count: pairmask_core::BoxCount::new(header.box_count),
    };
    let other = ReplyFields { frame: asked.frame ^ 1, ..asked };
    assert!(Reply::check_envelope(&header, &other).is_err(), "the answer to another frame");

    let detail = [header.detail[0], header.detail[1]];
    let _ = (lease_error(detail, INDEX_END), not_leased(detail), TermsDiffer::of_detail(detail));
    if let Err(error) = Reply::check_envelope(&header, &asked) {
        let _ = error.to_string();
        return;
    }
    let words = words_in(&pages);
    if let Ok(reply) = Reply::parse(&header, &asked, payload_bytes) {
        culled(&header, &reply, words);
    }
    if let Ok(reply) = SceneReply::parse(&header, &asked, payload_bytes) {
        edited(&header, &reply, words);
    }
    if let Ok(reply) = CastReply::parse(&header, &asked, payload_bytes) {
        cast(&reply, &pages);
    }
    if let Ok(reply) = ObserveReply::parse(&header, &asked, payload_bytes)
        && let Ok(observed) = reply.read(&pages, INDEX_END)
    {
        assert!(observed.boxes.is_sorted_by(|a, b| a.index < b.index));
        assert!(observed.boxes.iter().all(|observed| observed.index < INDEX_END));
    }
    let bytes: &[u8] = bytemuck::cast_slice(&pages);
    let _ = StatusBody::parse(&header, &asked, bytes);
    if let Ok(terms) = parse_joined(&header, &asked) {
        assert!(terms.most_boxes > 0 && !terms.deadline.is_zero());
    }
    if let Ok(range) = parse_leased(&header, &asked) {
        assert!(range.start < range.end);
    }
}

fn culled(header: &ResponseHeader, reply: &Reply, words: &[u32]) {
    let (n, shape) = (reply.box_count, &reply.report.shape);
    assert!(shape.extent_words() <= words.len() as u64, "a mask beyond its payload");
    if n.get() <= FEW_BOXES {
        masks::check(n, shape, words);
    } else {
        let mask = MaskView::new(n, shape, words).expect("a shape that was checked");
        let mut pairs = 0;
        mask.for_each(|a, b| {
            assert!(a < b && b < n.get());
            pairs += 1;
        });
        assert!(mask.count() >= pairs);
        let _ = mask.verify();
    }
    let Ok(ranges) = world_ranges_in(header, shape, words) else { return };
    let MaskShape::List { pairs } = shape else {
        assert!(ranges.is_empty());
        return;
    };
    let mut end = 0;
    for range in &ranges {
        assert_eq!(range.pairs.start, end, "side by side");
        end = range.pairs.end;
    }
    assert!(ranges.is_empty() || end as u64 == pairs.len / 2, "all pairs are of a world");
}

fn edited(header: &ResponseHeader, reply: &SceneReply, words: &[u32]) {
    let layout = &reply.layout;
    for span in [&layout.begun, &layout.pairs] {
        let pairs = SceneAnswerLayout::pairs_in(span, words);
        assert_eq!(2 * pairs.len() as u64, span.len, "a span beyond its payload");
    }
    for ended in layout.ended_in(words, INDEX_END) {
        assert!(ended.pair[0] < ended.pair[1] && ended.pair[1] < INDEX_END);
    }
    let payload_bytes = 4 * words.len() as u64;
    let Ok(marks) = TickMarks::parse(header, payload_bytes) else { return };
    assert!(marks.late_in(words).iter().all(|range| !range.is_empty()));
    let user_data = marks.user_data_in(words).count() as u64;
    assert_eq!(3 * user_data, marks.user_data.len, "user data beyond its payload");
    // Of a payload that is shorter than the one that it was checked for.
    let _ = (marks.late_in(&[]), marks.user_data_in(&[]).count(), layout.ended_in(&[], 9).count());
}

fn cast(reply: &CastReply, pages: &[Page]) {
    let rays = [Ray::default(); 3];
    for hits in [Hits::All, Hits::Closest(2), Hits::Any] {
        let shapes = Shapes::Rays(&rays);
        let request = CastRequest::new(SceneId(1), None, shapes, hits, &QueryFilterData::None);
        let Ok(found) = reply.read(pages, &request.expect("few"), INDEX_END) else { continue };
        let is_one = hits == Hits::Any;
        let is_box = |hit: &Hit| if is_one { hit.index == Hit::ANY } else { hit.index < INDEX_END };
        assert!(found.iter().all(|hit| hit.query < 3 && is_box(hit)));
        assert!(found.is_sorted_by_key(|hit| hit.query));
    }
}
