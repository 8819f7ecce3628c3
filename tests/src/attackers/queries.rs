//! A client that forges queries of a scene, casts into it and frames of two sets, and changes them while the daemon reads
//! them.

use std::time::Duration;

use bytemuck::{cast_slice, cast_slice_mut};
use pairmask_core::cast::{Hits, Ray, Shapes};
use pairmask_core::filters::FilterData;
use pairmask_core::precision::BoxForm;
use pairmask_core::scene::{Edit, QueryFilterData, QueryMask, Report, Sets, Step};
use pairmask_core::{Aabb, BoxCount, Encoding, Sphere};
use pairmask_wire::{
    CastRequest, CullRequest, EditLayout, Page, QueryRequest, RequestHeader, SceneId, SceneRequest,
    SceneSections,
};
use pairmaskd::scene::Random;

use super::raw::RawClient;
use super::{Forging, Tally, Until, scene_request};

/// Boxes of its scene, of a few queries, and of a frame.
const BOXES: u32 = 300;
const SCENE: SceneId = SceneId(1);
const FORGING: Forging = Forging { payload_words: 1, ..Forging::new(1 << 46, 16) };

fn boxes(dice: &mut Random, count: u32) -> Vec<Aabb> {
    let a_box = |_| {
        let min = [(); 3].map(|()| dice.below(12) as f32);
        Aabb::new(min, min.map(|x| x + dice.below(3) as f32))
    };
    (0..count).map(a_box).collect()
}

fn edit(client: &RawClient, dice: &mut Random, revision: u64) -> Option<bool> {
    let boxes = boxes(dice, BOXES);
    let steps = [Step::Set(Sets { indices: (0..BOXES).into(), boxes: &boxes })];
    let edit = Edit { steps: &steps };
    let layout = EditLayout::of(edit)?;
    let mut loan = client.loan()?;
    let _ = layout.write(edit, loan.pages_mut());
    let request = scene_request(dice, [SCENE.0, BOXES], [0, revision], &layout);
    let request = SceneRequest { report: Report::Nothing, ..request };
    loan.header = RequestHeader::edit_scene(FORGING.token, revision, &request);
    let answered = client.send(loan).answer(Duration::from_secs(2))?;
    Some(answered.status == 0)
}

/// A query, a cast or a frame of two sets, as it should be, in the payload.
fn request(dice: &mut Random, frame: u64, revision: u64, payload: &mut [Page]) -> RequestHeader {
    let count = dice.below(70) as u32;
    if dice.below(3) == 0 {
        let n = BoxCount::new(BOXES);
        let bytes: &mut [u8] = cast_slice_mut(payload);
        let boxes = boxes(dice, BOXES);
        bytes[..24 * boxes.len()].copy_from_slice(cast_slice(&boxes));
        let scene = SceneSections::first(BoxForm::F32, n);
        let first_set = Some(BoxCount::new(count));
        let request = CullRequest { first_set, ..CullRequest::of(scene) };
        return RequestHeader::cull(FORGING.token, frame, &request);
    }
    let filter_data = vec![FilterData::default(); count as usize];
    let filter_data = match dice.below(3) {
        0 => QueryFilterData::None,
        1 => QueryFilterData::One(FilterData::default()),
        _ => QueryFilterData::Each(&filter_data),
    };
    if dice.below(2) == 0 {
        let points: Vec<[f32; 3]> =
            (0..count).map(|_| [(); 3].map(|()| dice.below(12) as f32)).collect();
        let rays: Vec<Ray> = points.iter().map(|at| Ray::new(*at, [1.0, 0.5, 0.0])).collect();
        let spheres: Vec<Sphere> = points.iter().map(|at| Sphere::new(*at, 3.0)).collect();
        let shapes =
            if dice.below(2) == 0 { Shapes::Rays(&rays) } else { Shapes::Spheres(&spheres) };
        let hits = [Hits::All, Hits::Closest(3), Hits::Any][dice.below(3) as usize];
        let request = CastRequest::new(SCENE, Some(revision), shapes, hits, &filter_data);
        let request = request.expect("few shapes");
        let _ = request.write(shapes, &filter_data, payload);
        return RequestHeader::cast_scene(FORGING.token, frame, &request);
    }
    let encoding = Encoding::ALL[dice.below(3) as usize];
    let mask = QueryMask::new(count as usize, BOXES).expect("few objects");
    let request = QueryRequest::new(SCENE, Some(revision), mask, encoding, &filter_data);
    let _ = request.write(&boxes(dice, count), &filter_data, payload);
    RequestHeader::query_scene(FORGING.token, frame, &request)
}

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut revision = 0;
    FORGING.attack(until, tally, |client, dice, payload, frame, _| {
        if frame % 100 == 0 {
            revision += 1;
            edit(client, dice, revision)?;
        }
        Some(request(dice, frame, revision, payload))
    });
}
