//! A request: its header, then its payload.

use pairmask_core::cast::Hits;
use pairmask_core::objects::Objects;
use pairmask_core::scene::shared::{Leases, MemberId};
use pairmask_core::scene::{Cast, Edit, Report, Scene, SceneOptions, Sets, Step};
use pairmask_core::units::BoxCount;
use pairmask_core::{Aabb, scene::QueryFilterData};
use pairmask_wire::{
    CastRequest, CullRequest, EditScratch, LeaseAction, LeaseRequest, PAGE_BYTES, Page,
    QueryRequest, Request, RequestHeader, RulesReader, RulesSections, SceneName, SceneRequest,
};

use crate::input::pages_of;

/// Indices of a scene that is edited: a box at the last one takes memory for all.
const MOST_BOXES: u32 = 1 << 12;

pub fn decode(data: &[u8]) {
    let Some((header, payload)) = data.split_at_checked(size_of::<RequestHeader>()) else { return };
    let header: RequestHeader = bytemuck::pod_read_unaligned(header);
    let pages = pages_of(payload);
    let payload_bytes = (pages.len() * PAGE_BYTES) as u64;
    let Ok(request) = Request::parse(&header, payload_bytes) else { return };
    let again = written(&header, &request);
    assert_eq!(Request::parse(&again, payload_bytes), Ok(request), "written and parsed again");
    assert!(read(&request, &pages), "checked, and not in its payload");
    // A payload that is shorter than the one that a header was checked for is found out where it is read.
    read(&request, &pages[..0]);
}

/// Reads and does what a request asks for. Whether all that its header names is in the payload.
fn read(request: &Request, pages: &[Page]) -> bool {
    match request {
        Request::Cull(request) => read_cull(request, pages),
        Request::EditScene(request) | Request::CommitShared(request) => {
            edit(request, pages);
            true
        }
        Request::QueryScene(request) => query(request, pages).is_some(),
        Request::CastScene(request) => cast(request, pages).is_some(),
        Request::JoinShared(request) => {
            let name = SceneName::read(request, pages);
            assert!(name.is_none_or(|name| !name.as_str().is_empty()));
            true
        }
        Request::LeaseShared(request) => {
            lease(request);
            true
        }
        Request::Status
        | Request::EndScene(_)
        | Request::LeaveShared(_)
        | Request::ObserveShared(_) => true,
    }
}

/// The header that says what was parsed of one.
fn written(header: &RequestHeader, request: &Request) -> RequestHeader {
    let RequestHeader { client_token, frame, .. } = *header;
    match request {
        Request::Cull(request) => RequestHeader::cull(client_token, frame, request),
        Request::Status => RequestHeader::status(client_token, frame),
        Request::EditScene(request) => RequestHeader::edit_scene(client_token, frame, request),
        Request::EndScene(scene) => RequestHeader::end_scene(client_token, frame, *scene),
        Request::QueryScene(request) => RequestHeader::query_scene(client_token, frame, request),
        Request::CastScene(request) => RequestHeader::cast_scene(client_token, frame, request),
        Request::JoinShared(request) => RequestHeader::join_shared(client_token, frame, request),
        Request::LeaseShared(request) => RequestHeader::lease_shared(client_token, frame, request),
        Request::CommitShared(request) => {
            RequestHeader::commit_shared(client_token, frame, request)
        }
        Request::ObserveShared(request) => {
            RequestHeader::observe_shared(client_token, frame, request)
        }
        Request::LeaveShared(scene) => RequestHeader::leave_shared(client_token, frame, *scene),
    }
}

fn read_cull(request: &CullRequest, pages: &[Page]) -> bool {
    let n = request.scene.count;
    let objects = request.scene.objects_in(pages);
    if let Some(objects) = objects {
        assert_eq!((objects.len(), objects.form()), (n.len(), request.scene.form));
        if let Objects::Boxes(boxes) = objects {
            assert_eq!(boxes.get(boxes.len()), None);
            boxes.get(boxes.len().saturating_sub(1));
        }
    }
    if let Some(slot) = &request.rules {
        read_rules(slot, n, pages);
    }
    objects.is_some()
}

fn read_rules(slot: &RulesSections, n: BoxCount, pages: &[Page]) {
    let mut reader = RulesReader::default();
    let Ok(sent) = reader.read(slot, n, pages).cloned() else { return };
    let again = reader.read(slot, n, pages).expect("as before");
    assert_eq!(sent.number(), again.number(), "the same rules, once more");
    assert!(sent.most_worlds() <= u64::from(n.get()));
    let rules = sent.rules();
    let last = n.get().saturating_sub(1);
    for [a, b] in rules.lists.included().chain(rules.lists.excluded()) {
        assert!(a <= last && b <= last, "a listed pair of boxes that there are not");
    }
    if n > BoxCount::new(1) {
        assert!(!sent.let_all_meet() || rules.meet(0, last));
    }
}

fn edit(request: &SceneRequest, pages: &[Page]) {
    let mut scratch = EditScratch::default();
    let is_copied = scratch.copy(request, pages).is_ok();
    let mut in_place = EditScratch::default();
    let Ok(steps) = in_place.read(request, pages) else {
        assert!(!is_copied, "copied, and not read");
        return;
    };
    assert_eq!(scratch.steps().map(|copied| copied.len()), Ok(steps.len()));
    let edit = Edit { steps: &steps };
    // What a daemon asks before it applies an edit.
    let asked = (edit.boxes(), edit.index_end(), edit.rule_bytes(), edit.user_data_bytes());
    let mut leases = Leases::default();
    let _ = leases.take(MemberId(1), 0..request.most_boxes / 2, u32::MAX);
    let allowed = leases.of(MemberId(1)).allow(edit, true);
    assert!(allowed.is_err() || asked.1 <= u64::from(request.most_boxes / 2), "not leased");
    let most_boxes = request.most_boxes.min(MOST_BOXES);
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(most_boxes));
    if request.is_lost {
        scene.resync();
    }
    if scene.edit(edit, request.report).is_err() {
        assert!(scene.is_empty(), "refused, and applied");
        return;
    }
    if let Some(pair_count) = request.reported {
        scene.mark_reported(pair_count);
    }
    assert!(scene.len() <= asked.0, "more boxes than it sets");
    let _ = scene.edit(Edit::NONE, Report::Changes);
    scene.acknowledge();
}

/// Some boxes for those who ask.
fn scene() -> Scene {
    let mut scene = Scene::new(SceneOptions::default());
    let boxes = [0.0, 0.5, 3.0].map(|x| Aabb::new([x; 3], [x + 1.0; 3]));
    let set = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
    scene.edit(Edit { steps: &set }, Report::Nothing).expect("three boxes");
    scene
}

fn query(request: &QueryRequest, pages: &[Page]) -> Option<()> {
    let (boxes, filter_data) = request.read(pages)?;
    assert_eq!(boxes.len(), request.mask.queries() as usize);
    let mut found = Vec::new();
    scene().query(boxes, filter_data, &mut found).expect("few pairs");
    assert!(found.iter().all(|[query, index]| (*query as usize) < boxes.len() && *index < 3));
    Some(())
}

/// Hits that a cast may have.
const MOST_HITS: u64 = 1 << 12;

fn cast(request: &CastRequest, pages: &[Page]) -> Option<()> {
    let (shapes, filter_data) = request.read(pages)?;
    assert_eq!(shapes.len(), request.count() as usize);
    if let QueryFilterData::Each(each) = filter_data {
        assert_eq!(each.len(), shapes.len());
    }
    let cast = Cast { shapes, hits: request.hits, filter_data, most_hits: MOST_HITS };
    let mut found = Vec::new();
    scene().cast(&cast, &mut found).expect("few hits");
    let is_one = request.hits == Hits::Any;
    assert!(
        found.iter().all(|hit| (hit.query as usize) < shapes.len() && (is_one || hit.index < 3))
    );
    Some(())
}

fn lease(request: &LeaseRequest) {
    let mut leases = Leases::default();
    let (own, other, limit) = (MemberId(1), MemberId(2), 1 << 16);
    leases.take(other, 100..110, limit).expect("free");
    let changed = match request.action {
        // As a daemon does.
        LeaseAction::Take { first, count } => {
            let range = first..first.saturating_add(count);
            leases.take(own, range.clone(), limit).map(|()| range)
        }
        LeaseAction::TakeAny { count } => leases.take_any(own, count, limit),
        LeaseAction::GiveBack { first } => leases.give_back(own, first),
    };
    if let Ok(range) = changed {
        assert!(range.start < range.end && range.end <= limit);
        assert!(range.end <= 100 || range.start >= 110, "of another member");
    }
}
