//! The wire contract: golden bytes, and arbitrary bytes from the other side. One file, because both read the
//! same headers, request and response, and the golden ones are what the arbitrary ones are made from.

use bytemuck::Zeroable;
use pairmask_core::Aabb;
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{
    Census, CullReport, EngineChoice, EngineId, EngineName, EngineTimes, PairSkips, SkipMeter,
};
use pairmask_core::mask::{Encoding, EncodingChoice, MaskShape, MaskView};
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::{Bounds, BoxF16, BoxForm, Quantizer};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    AuditCounts, CullRequest, LAST_ERRORS, Page, RecordedError, Reject, Reply, ReplyError,
    ReplyFields, Request, RequestHeader, ResponseHeader, SceneSections, Section, SectionKind,
    StatusBody, StatusCode, Version, response_error, response_ok, response_status,
};
use proptest::prelude::*;

use crate::{Bytes, TOKEN, forged};

const N: BoxCount = BoxCount::new(100);
const ASKED: ReplyFields = ReplyFields { client_token: TOKEN, frame: 9, box_count: N };

fn request() -> RequestHeader {
    request_of(BoxForm::F32)
}

fn request_of(form: impl Into<ObjectForm>) -> RequestHeader {
    RequestHeader::cull(ASKED.client_token, ASKED.frame, &cull_of(form))
}

fn cull_of(form: impl Into<ObjectForm>) -> CullRequest {
    CullRequest {
        engine: EngineChoice::Only(EngineName::CpuBrute),
        encoding: EncodingChoice::Only(Encoding::Sparse),
        threads: Some(2),
        iterate_threads: Some(8),
        ..CullRequest::of(SceneSections::first(form, N))
    }
}

fn report(shape: MaskShape) -> CullReport {
    CullReport {
        shape,
        census: Census { invalid: 1, empty: 2, first_invalid: [5, 0, 0, 0, 0, 0, 0, 0] },
        pair_count: 3,
        skipped: SkipMeter {
            boxes: 3,
            pairs: 4,
            why: PairSkips::NONE.with_cells_of(4),
            zero_words: 5,
        },
        times: EngineTimes { ingest_ns: 10, execute_ns: 30, publish_ns: 40 },
    }
}

const TIMES: StageTimes =
    StageTimes { ingest_ns: 10, plan_ns: 20, execute_ns: 30, publish_ns: 40, total_ns: 110 };

fn response(shape: MaskShape) -> ResponseHeader {
    response_ok(&ASKED, EngineName::CpuBrute, 2, &report(shape), &TIMES)
}

#[test]
fn golden_request() {
    for (form, kind, bytes) in [
        (ObjectForm::Boxes(BoxForm::F32), 1, 2400),
        (ObjectForm::Boxes(BoxForm::Q16), 8, 1200),
        (ObjectForm::Boxes(BoxForm::Q8), 9, 600),
        (ObjectForm::Boxes(BoxForm::F16), 10, 1200),
        (ObjectForm::Spheres, 11, 1600),
    ] {
        let expected = Bytes::of_magic(b"PMRQ")
            .u32(&[1, 0])
            .u64(&[TOKEN, 9])
            .u32(&[100, 1, 2, 2])
            .section((kind, 0, bytes))
            .zeros_to(240)
            .u32(&[8, 0])
            .zeros_to(272);
        assert_eq!(bytemuck::bytes_of(&request_of(form)), expected.0, "{form}");
    }
}

#[test]
fn golden_narrow_boxes() {
    let bounds = Bounds::new([0.0; 3], [256.0; 3]).unwrap();
    let boxes = [
        Aabb::from([0.0, 1.0, -5.0, 1.5, 255.5, 300.0]),
        Aabb::EMPTY,
        Aabb::from([0.0, 0.0, f32::NAN, 1.0, 1.0, 1.0]),
    ];
    let mut q16: Vec<u8> = Vec::new();
    let mut q8: Vec<u8> = Vec::new();
    for b in &boxes {
        q16.extend(bytemuck::bytes_of(&Quantizer::q16_of(&bounds).q16(b)));
        q8.extend(bytemuck::bytes_of(&Quantizer::q8_of(&bounds).q8(b)));
    }
    let words =
        |words: [u16; 18]| -> Vec<u8> { words.iter().flat_map(|w| w.to_le_bytes()).collect() };
    assert_eq!(
        q16,
        words([0, 256, 0, 384, 65_408, 65_535, 1, 1, 1, 0, 0, 0, 65_535, 65_535, 65_535, 0, 0, 0])
    );
    assert_eq!(q8, [0, 1, 0, 1, 255, 255, 1, 1, 1, 0, 0, 0, 255, 255, 255, 0, 0, 0]);
    let half: Vec<u8> =
        boxes.iter().flat_map(|b| bytemuck::cast::<_, [u8; 12]>(BoxF16::from(b))).collect();
    assert_eq!(
        half,
        words([
            0, 0x3c00, 0xc500, 0x3e00, 0x5bfc, 0x5cb0, 0x7c00, 0x7c00, 0x7c00, 0xfc00, 0xfc00,
            0xfc00, 0x7e00, 0x7e00, 0x7e00, 0x7e00, 0x7e00, 0x7e00
        ])
    );
}

#[test]
fn golden_spheres() {
    let spheres = [Sphere::new([1.0, -2.0, 0.5], 3.0), Sphere::EMPTY];
    let floats = [1.0f32, -2.0, 0.5, 3.0, 0.0, 0.0, 0.0, -1.0];
    let expected: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(bytemuck::cast_slice::<Sphere, u8>(&spheres), expected);
}

#[test]
fn golden_response() {
    // 7 words of room: sections start on multiples of 16 words, that is 64 bytes.
    let sparse = [(3, 0, 20), (4, 64, 20), (5, 128, 20), (6, 192, 400)];
    let list = [(12, 0, 24)];
    for (shape, encoding, sections) in
        [(MaskShape::sparse(N, 7, 5, true), 2, &sparse[..]), (MaskShape::list(3), 3, &list)]
    {
        let expected = Bytes::of_magic(b"PMRS")
            .u32(&[0, 0])
            .u64(&[TOKEN, 9])
            .u32(&[100, 1, encoding, 1, 2, 2])
            .u32(&[5, 0, 0, 0, 0, 0, 0, 0])
            .u64(&[3])
            .u64(&[3, 4, 5, 0, 0, 0])
            .u64(&[10, 20, 30, 40, 110, 0, 0, 0])
            .u64(&[0; 4]);
        let expected = sections.iter().fold(expected, |bytes, section| bytes.section(*section));
        assert_eq!(bytemuck::bytes_of(&response(shape)), expected.zeros_to(432).0);
    }
    // The payload of a list, as WIRE.md has it: in the order of the engine.
    let words = [4, 9, 0, 99, 0, 1];
    let reply = Reply::parse(&response(MaskShape::list(3)), &ASKED, 24).unwrap();
    let view = MaskView::new(N, &reply.report.shape, &words).unwrap();
    assert_eq!(view.to_vec(), [[4, 9], [0, 99], [0, 1]]);
    assert_eq!(view.verify(), Ok(()));
}

#[test]
fn forged_lists_are_refused() {
    let forge = |change: fn(&mut ResponseHeader)| {
        Reply::parse(&forged(response(MaskShape::list(3)), change), &ASKED, 4096)
    };
    assert!(forge(|_| {}).is_ok());
    let longest = forge(|h| h.sections[0].bytes = 4096);
    assert_eq!(longest.map(|reply| reply.report.shape), Ok(MaskShape::list(512)));
    for change in [
        // Half a pair, and less than a word.
        (|h| h.sections[0].bytes = 20) as fn(&mut ResponseHeader),
        |h| h.sections[0].bytes = 23,
        |h| h.sections[0].bytes = 4104,
        |h| h.sections[0].bytes = u64::MAX - 7,
        |h| h.sections[0].offset = 2,
        |h| h.sections[0].offset = u64::MAX - 7,
        |h| h.sections[0].kind = SectionKind::DenseWords as u32,
        |h| h.sections[1] = h.sections[0],
        |h| h.encoding = Encoding::Sparse as u32,
        |h| h.encoding = Encoding::Dense as u32,
    ] {
        assert!(matches!(forge(change), Err(ReplyError::Malformed { .. })));
    }
}

#[test]
fn golden_status_body() {
    let mut body = StatusBody {
        pid: 1,
        client_count: 2,
        uptime_ns: 3,
        frames: 4,
        boxes: 5,
        pairs: 6,
        errors: 7,
        ..StatusBody::default()
    };
    body.audit =
        AuditCounts { one_in: 11, frames: 12, skipped: 13, pairs: 14, missed: 15, extra: 16 };
    (body.spheres, body.scenes, body.scene_mib) = (17, 18, 19);
    body.last_errors[0] =
        RecordedError { client_token: 8, frame: 9, at_ns: 10, status: 4, reserved: 0 };
    let expected = Bytes::default()
        .u32(&[1, 2])
        .u64(&[3, 4, 5, 6, 7])
        .u64(&[8, 9, 10])
        .u32(&[4, 0])
        .zeros_to(48 + LAST_ERRORS * 32)
        .u64(&[11, 12, 13, 14, 15, 16, 17])
        .u32(&[18, 19]);
    assert_eq!(bytemuck::bytes_of(&body), expected.0);
}

#[test]
fn a_request_round_trips() {
    for form in ObjectForm::ALL {
        let request = cull_of(form);
        assert_eq!(Request::parse(&request_of(form), 4096), Ok(Request::Cull(request)));
    }
    let status = RequestHeader::status(1, 2);
    assert_eq!(Request::parse(&status, 4096), Ok(Request::Status));
}

#[test]
fn a_request_to_be_culled_anew_is_a_flag() {
    let scene = SceneSections::first(BoxForm::F32, N);
    let anew = CullRequest { may_repeat: false, ..CullRequest::of(scene) };
    let header = RequestHeader::cull(1, 2, &anew);
    assert_eq!(header.flags, 1);
    assert_eq!(Request::parse(&header, 4096), Ok(Request::Cull(anew)));
    let unknown = RequestHeader { flags: !1, ..header };
    assert_eq!(Request::parse(&unknown, 4096), Ok(Request::Cull(CullRequest::of(scene))));
}

#[test]
fn a_cull_of_two_sets_is_an_operation() {
    for form in ObjectForm::ALL {
        let scene = SceneSections::first(form, N);
        for first in [0, 1, N.get(), N.get() + 1, u32::MAX] {
            let first_set = Some(BoxCount::new(first));
            let request = CullRequest { first_set, ..CullRequest::of(scene) };
            let header = RequestHeader::cull(1, 2, &request);
            assert_eq!((header.operation, header.most_boxes), (6, first));
            let parsed = Request::parse(&header, 4096);
            if form == ObjectForm::Spheres {
                assert_eq!(parsed, Err(Reject::Query("form")));
            } else if first > N.get() {
                assert_eq!(parsed, Err(Reject::Query("first set")));
            } else {
                assert_eq!(parsed, Ok(Request::Cull(request)));
            }
        }
    }
}

#[test]
fn reasons_of_skipped_pairs_stand_where_zeros_stood() {
    let of_report = |skipped: SkipMeter| {
        let report = CullReport { skipped, ..report(MaskShape::dense(N)) };
        let header = response_ok(&ASKED, EngineName::CpuSap, 1, &report, &TIMES);
        (header.skipped, Reply::parse(&header, &ASKED, 4096).unwrap().report.skipped)
    };
    let why = PairSkips::of_frame(0, 7, 20).with_cells_of(40);
    let meter = SkipMeter { boxes: 3, pairs: 40, why, zero_words: 5 };
    assert_eq!(of_report(meter), ([3, 40, 5, 0, 7, 20], meter));
    let again = SkipMeter::of_repeat(N, &meter);
    assert_eq!(of_report(again), ([100, 4950, 5, 4950, 0, 0], again));
    assert!(again.is_repeat() && !meter.is_repeat());
    // A daemon may write any numbers.
    let mut header = response(MaskShape::dense(N));
    header.skipped = [u64::MAX; 6];
    let parsed = Reply::parse(&header, &ASKED, 4096).unwrap().report.skipped;
    assert_eq!((parsed.why.cell, parsed.why.total()), (0, u64::MAX));
}

/// A client of the same major version is answered regardless of its minor.
#[test]
fn clients_of_every_minor_version_are_answered() {
    for minor in [0, 1, Version::CURRENT.minor + 1, u16::MAX] {
        let header = RequestHeader { version_minor: minor, ..request() };
        assert_eq!(Request::parse(&header, 4096), Request::parse(&request(), 4096), "{minor}");
    }
}

#[test]
fn numbers_of_later_versions_stay_numbers() {
    let parse = |change: &dyn Fn(&mut ResponseHeader)| {
        let header = forged(response(MaskShape::sparse(N, 5, 5, true)), change);
        Reply::parse(&header, &ASKED, 4096).map(|reply| reply.engine)
    };
    assert_eq!(parse(&|_| ()), Ok(EngineId::Known(EngineName::CpuBrute)));
    assert_eq!(parse(&|h| h.engine = 17), Ok(EngineId::Unknown(17)));
    assert_eq!(parse(&|h| h.status = 99), Err(ReplyError::UnknownStatus { found: 99 }));
    assert_eq!(parse(&|h| h.encoding = 98), Err(ReplyError::UnknownEncoding { found: 98 }));
    let unknown = |flags| Section { kind: 97, flags, offset: 0, bytes: 4 };
    let required = parse(&|h| h.sections[6] = unknown(Section::REQUIRED));
    assert_eq!(required, Err(ReplyError::UnknownSection { found: 97 }));
    assert!(parse(&|h| h.sections[6] = unknown(0)).is_ok(), "it may be passed over");
}

#[test]
fn a_response_round_trips() {
    for shape in
        [MaskShape::dense(N), MaskShape::sparse(N, 7, 5, true), MaskShape::sparse(N, 5, 5, false)]
    {
        let reply = Reply::parse(&response(shape), &ASKED, 4096).unwrap();
        assert_eq!(reply.report, report(shape));
        assert_eq!((reply.times, reply.threads, reply.box_count), (TIMES, 2, N));
    }
}

#[test]
fn forged_requests_are_refused() {
    let refused = |header: RequestHeader, change: fn(&mut RequestHeader)| {
        Request::parse(&forged(header, change), 4096).unwrap_err()
    };
    let forge = |change| refused(request(), change);
    assert!(matches!(forge(|h| h.magic ^= 1), Reject::Magic(_)));
    let version = forge(|h| h.version_major = 2);
    assert_eq!(version.status(), StatusCode::VersionMismatch);
    assert_eq!(forge(|h| h.operation = 99), Reject::Operation(99));
    assert_eq!(forge(|h| h.engine = 99), Reject::Engine(99));
    assert_eq!(forge(|h| h.encoding = 99), Reject::Encoding(99));
    let unknown = forge(|h| {
        h.sections[3] = Section { kind: 77, flags: Section::REQUIRED, ..Section::default() };
    });
    assert_eq!(unknown, Reject::UnknownSection(77));
    let spheres = request_of(ObjectForm::Spheres);
    assert!(Request::parse(&spheres, 4096).is_ok());
    let of_boxes: [fn(&mut RequestHeader); 12] = [
        |h| h.sections[0].bytes += 1,
        |h| h.sections[0].offset = 4096 - 2396,
        |h| h.sections[0].offset = u64::MAX - 3,
        |h| h.sections[0].offset = 2,
        |h| h.box_count = u32::MAX,
        |h| h.sections[0] = Section::zeroed(),
        |h| h.sections[1] = h.sections[0],
        |h| h.sections[1] = request_of(BoxForm::Q16).sections[0],
        |h| h.sections[0].kind = SectionKind::BoxesQ16 as u32,
        |h| h.sections[0] = Section { bytes: 2400, ..request_of(BoxForm::Q8).sections[0] },
        |h| h.sections[0].kind = SectionKind::Spheres as u32,
        |h| h.sections[7] = request_of(ObjectForm::Spheres).sections[0],
    ];
    let of_spheres: [fn(&mut RequestHeader); 7] = [
        |h| h.sections[0].bytes -= 16,
        |h| h.sections[0].offset = 4096 - 1596,
        |h| h.box_count += 1,
        |h| h.sections[0].kind = SectionKind::Boxes as u32,
        |h| h.sections[1] = Section { flags: 0, ..h.sections[0] },
        |h| h.sections[1] = request().sections[0],
        // The most that a header can announce is more than any payload.
        |h| (h.box_count, h.sections[0].bytes) = (u32::MAX, 16 * u64::from(u32::MAX)),
    ];
    for (header, changes) in [(request(), &of_boxes[..]), (spheres, &of_spheres)] {
        for change in changes {
            let refused = refused(header, *change);
            assert!(matches!(refused, Reject::Objects { .. }), "{refused}");
            assert_eq!(refused.status(), StatusCode::BadRequest);
        }
    }
}

#[test]
fn a_later_minor_version_may_add_what_old_readers_pass_over() {
    let mut header = request();
    header.version_minor = 7;
    header.flags = 0xffff_ffff;
    (header.scene, header.base, header.revision) = (1, 1, 1);
    (header.most_boxes, header.scene_flags) = (1, 1);
    header.sections[5] = Section { kind: 77, flags: 0, offset: u64::MAX, bytes: u64::MAX };
    assert!(Request::parse(&header, 4096).is_ok());
}

#[test]
fn forged_responses_are_refused() {
    let forge = |change: fn(&mut ResponseHeader)| {
        let header = forged(response(MaskShape::sparse(N, 5, 5, true)), change);
        Reply::parse(&header, &ASKED, 4096).unwrap_err()
    };
    assert_eq!(forge(|h| h.magic ^= 1), ReplyError::Envelope);
    assert_eq!(forge(|h| h.version_major = 9), ReplyError::Envelope);
    assert!(matches!(forge(|h| h.frame = 8), ReplyError::Frame { expected: 9, found: 8 }));
    assert_eq!(forge(|h| h.client_token = 8), ReplyError::Client);
    for change in [
        (|h| h.box_count = 99) as fn(&mut ResponseHeader),
        |h| h.encoding = Encoding::Dense as u32,
        |h| h.sections[0].bytes += 4,
        |h| h.sections[1].offset = u64::MAX - 3,
        |h| h.sections[2] = h.sections[1],
        |h| h.sections[2].offset += 2,
        |h| h.sections[3].bytes -= 4,
        |h| h.sections[4] = h.sections[3],
    ] {
        assert!(matches!(forge(change), ReplyError::Malformed { .. }));
    }
}

#[test]
fn errors_carry_their_numbers() {
    let header = response_error(&ASKED, StatusCode::ReplyTooLarge, [7, 5]);
    assert_eq!(
        Reply::parse(&header, &ASKED, 4096),
        Err(ReplyError::Status { status: StatusCode::ReplyTooLarge, detail: [7, 5] })
    );
}

#[test]
fn a_status_body_is_checked_against_its_payload() {
    let mut page = vec![0u8; 4096];
    let body = StatusBody { frames: 5, ..StatusBody::default() };
    page[..size_of::<StatusBody>()].copy_from_slice(bytemuck::bytes_of(&body));
    let header = response_status(&ASKED);
    assert_eq!(StatusBody::parse(&header, &ASKED, &page), Ok(body));
    assert!(StatusBody::parse(&header, &ASKED, &page[..100]).is_err());
    for change in [
        (|h| h.sections[0].offset = 4096) as fn(&mut ResponseHeader),
        |h| h.sections[0].kind = SectionKind::Order as u32,
        |h| h.sections[0].bytes = 0,
        |h| h.sections[0].bytes *= 2,
    ] {
        assert!(StatusBody::parse(&forged(header, change), &ASKED, &page).is_err());
    }
}

/// Any header near a valid one: some bytes of it replaced.
pub fn mutated<const BYTES: usize>(valid: [u8; BYTES]) -> impl Strategy<Value = [u8; BYTES]> {
    let interesting = prop_oneof![any::<u8>(), Just(0u8), Just(0xff), Just(0x80), Just(0x7f)];
    proptest::collection::vec((0..BYTES, interesting), 0..12).prop_map(move |changes| {
        let mut bytes = valid;
        for (at, value) in changes {
            bytes[at] = value;
        }
        bytes
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Every accepted request lies within the payload.
    #[test]
    fn fuzz_request(
        bytes in prop::sample::select(&ObjectForm::ALL[..])
            .prop_flat_map(|form| mutated::<272>(bytemuck::cast(request_of(form)))),
        payload_pages in 0u64..3,
    ) {
        let header: RequestHeader = bytemuck::cast(bytes);
        let payload_bytes = payload_pages * 4096;
        if let Ok(Request::Cull(CullRequest { scene, .. })) =
            Request::parse(&header, payload_bytes)
        {
            let SceneSections { form, count, offset, .. } = scene;
            let object_bytes = match form {
                ObjectForm::Boxes(BoxForm::F32) => 24,
                ObjectForm::Boxes(BoxForm::Q16 | BoxForm::F16) => 12,
                ObjectForm::Boxes(BoxForm::Q8) => 6,
                ObjectForm::Spheres => 16,
            };
            let end = offset as u64 + object_bytes * u64::from(count.get());
            prop_assert!(end <= payload_bytes);
            prop_assert_eq!(offset % 4, 0);
            let pages: Vec<Page> = vec![Page::zeroed(); payload_pages as usize];
            let view = scene.objects_in(&pages);
            prop_assert_eq!(view.map(|v| (v.form(), v.len())), Some((form, count.len())));
        }
    }

    /// Every accepted response makes a view, and decoding the view is safe.
    #[test]
    fn fuzz_response(
        bytes in prop_oneof![
            mutated::<432>(bytemuck::cast(response(MaskShape::sparse(N, 7, 5, true)))),
            mutated::<432>(bytemuck::cast(response(MaskShape::dense(N)))),
            mutated::<432>(bytemuck::cast(response(MaskShape::list(30)))),
        ],
        payload in proptest::collection::vec(any::<u32>(), 0..400),
    ) {
        let header: ResponseHeader = bytemuck::cast(bytes);
        if let Ok(reply) = Reply::parse(&header, &ASKED, 4 * payload.len() as u64) {
            let view = MaskView::new(N, &reply.report.shape, &payload).unwrap();
            for [a, b] in view.pairs() {
                prop_assert!(a < b && b < N.get());
            }
        }
    }
}
