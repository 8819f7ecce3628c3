//! Casts on the wire: golden bytes, and arbitrary bytes from the other side.

use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::EngineName;
use pairmask_core::filters::FilterData;
use pairmask_core::scene::QueryFilterData;
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CastReply, CastRequest, ReplyFields, Request, RequestHeader, ResponseHeader, SceneId,
    response_cast,
};
use proptest::prelude::*;

use crate::frames::mutated;
use crate::shared_scenes::{ASKED, FRAME, Fields};
use crate::{TOKEN, pages};

#[test]
fn golden_cast() {
    let rays = [Ray::new([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]).up_to(7.0).with_half_extents([8.0; 3])];
    let spheres = [Sphere::new([1.0, 2.0, 3.0], 4.0); 2];
    let filter_data = QueryFilterData::One(FilterData::default());
    for (shapes, hits, encoding, most_boxes, sections) in [
        (Shapes::Rays(&rays), Hits::All, 1, 0, vec![(27, 0, 40), (23, 64, 12)]),
        (Shapes::Spheres(&spheres), Hits::Closest(8), 2, 8, vec![(11, 0, 32), (23, 64, 12)]),
        (Shapes::Rays(&rays), Hits::Any, 3, 0, vec![(27, 0, 40), (23, 64, 12)]),
    ] {
        let request = CastRequest::new(SceneId(5), Some(7), shapes, hits, &filter_data).unwrap();
        let header = RequestHeader::cast_scene(TOKEN, FRAME, &request);
        let fields = Fields {
            operation: 11,
            boxes: shapes.len() as u32,
            encoding,
            sections,
            scene: 5,
            base: 7,
            most_boxes,
            ..Fields::default()
        };
        assert_eq!(bytemuck::bytes_of(&header), fields.bytes(), "{hits:?}");
        let mut payload = pages(request.payload_bytes());
        assert!(request.write(shapes, &filter_data, &mut payload));
        let floats: &[f32] = bytemuck::cast_slice(&payload);
        assert_eq!(floats[..4], [1.0, 2.0, 3.0, 4.0]);
        if matches!(shapes, Shapes::Rays(_)) {
            assert_eq!(floats[4..10], [5.0, 6.0, 7.0, 8.0, 8.0, 8.0]);
        }
        assert_eq!(Request::parse(&header, 4096), Ok(Request::CastScene(request)));
    }
    let asked = ReplyFields { box_count: BoxCount::new(2), ..ASKED };
    let times = StageTimes::default();
    let header = response_cast(&asked, EngineName::CpuTree, 3, 5, &times);
    let section = header.sections[0];
    assert_eq!((section.kind, section.flags, section.offset, section.bytes), (28, 1, 0, 60));
    assert_eq!((header.box_count, header.pair_count, header.threads), (2, 5, 3));
    let reply = CastReply::parse(&header, &asked, 4096).unwrap();
    assert_eq!((reply.engine, reply.threads), (EngineName::CpuTree.into(), 3));
}

/// A cast of five rays, each with filter data of its own.
fn request(hits: Hits) -> CastRequest {
    let (rays, each) = ([Ray::default(); 5], [FilterData::default(); 5]);
    let filter_data = QueryFilterData::Each(&each);
    CastRequest::new(SceneId(1), Some(3), Shapes::Rays(&rays), hits, &filter_data).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// All shapes of an accepted request, and their filter data, lie within the payload.
    #[test]
    fn fuzz_cast_request(
        bytes in mutated::<272>(bytemuck::cast(
            RequestHeader::cast_scene(TOKEN, FRAME, &request(Hits::Closest(2)))
        )),
        payload_pages in 0u64..3,
    ) {
        let header: RequestHeader = bytemuck::cast(bytes);
        let payload = pages(4096 * payload_pages);
        if let Ok(Request::CastScene(request)) = Request::parse(&header, 4096 * payload_pages) {
            let (shapes, filter_data) = request.read(&payload).unwrap();
            prop_assert_eq!(shapes.len(), request.count() as usize);
            prop_assert!(filter_data.check(shapes.len()).is_ok());
        }
    }

    /// All hits of an accepted response are of rays and boxes that there are.
    #[test]
    fn fuzz_cast_response(
        bytes in mutated::<432>(bytemuck::cast(response_cast(
            &ReplyFields { box_count: BoxCount::new(5), ..ASKED },
            EngineName::CpuTree,
            1,
            7,
            &StageTimes::default(),
        ))),
        words in proptest::collection::vec(prop_oneof![0u32..6, Just(Hit::ANY), any::<u32>()], 21),
        asked in prop_oneof![
            Just(Hits::All),
            Just(Hits::Any),
            (0u32..4).prop_map(Hits::Closest),
        ],
    ) {
        let header: ResponseHeader = bytemuck::cast(bytes);
        let mut payload = pages(4096);
        bytemuck::cast_slice_mut(&mut payload)[..words.len()].copy_from_slice(&words);
        let fields = ReplyFields { box_count: BoxCount::new(5), ..ASKED };
        let read = CastReply::parse(&header, &fields, 4096)
            .and_then(|reply| reply.read(&payload, &request(asked), 4));
        for hit in read.unwrap_or_default() {
            prop_assert!(hit.query < 5);
            let is_box = if asked == Hits::Any { hit.index == Hit::ANY } else { hit.index < 4 };
            prop_assert!(is_box);
        }
    }
}
