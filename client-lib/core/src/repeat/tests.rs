//! Answers that are given again are those that a fresh engine would give.

use proptest::prelude::*;

use super::{Repeats, Seen};
use crate::aabb::Aabb;
use crate::dispatch::{CpuEngines, CullAnswer, CullOptions, SphereEngines};
use crate::engine::{EngineChoice, EngineName, HeapReply};
use crate::mask::{Encoding, EncodingChoice, MaskView, ReadableEncodings};
use crate::objects::Objects;
use crate::precision::{BoxForm, BoxSlice, Encoder, ExpandScratch, Precision};
use crate::sphere::Sphere;
use crate::units::BoxCount;

/// A session: what it remembers, and its reply.
#[derive(Default)]
struct Client {
    repeats: Repeats,
    reply: HeapReply,
}

/// What a frame was, and its pairs.
struct Frame {
    answer: CullAnswer,
    pairs: Vec<(u32, u32)>,
}

fn pairs(n: usize, answer: &CullAnswer, words: &[u32]) -> Vec<(u32, u32)> {
    let n = BoxCount::of_len(n).expect("few");
    let mask = MaskView::new(n, &answer.report.shape, words).expect("as it was written");
    let mut pairs = mask.to_vec();
    pairs.sort_unstable();
    pairs
}

fn cull(objects: Objects<'_>, options: &CullOptions, reply: &mut HeapReply) -> CullAnswer {
    let culled = match objects {
        Objects::Boxes(boxes) => {
            let mut scratch = ExpandScratch::default();
            CpuEngines::new().cull(boxes.expand(&mut scratch, false), options, reply)
        }
        Objects::Spheres(spheres) => SphereEngines::new().cull(spheres, options, reply),
    };
    culled.expect("a few objects")
}

impl Client {
    fn frame(&mut self, objects: Objects<'_>, options: &CullOptions) -> Frame {
        let seen = self.repeats.look(objects, options, &mut self.reply);
        let answer = match seen {
            Seen::Answered(answer) => answer,
            _ => cull(objects, options, &mut self.reply),
        };
        let pairs = pairs(objects.len(), &answer, self.reply.words());
        if seen == Seen::Alike
            && let Some(ticket) = self.repeats.ticket()
        {
            ticket.keep(objects, self.reply.words(), &answer);
            // The memory of the reply goes to the client, which may write to it.
            self.reply.fill(0xdead_beef);
        }
        Frame { answer, pairs }
    }

    /// As [`frame`](Self::frame), held to fresh engines. Whether it was answered again.
    fn checked(&mut self, objects: Objects<'_>, options: &CullOptions) -> bool {
        let frame = self.frame(objects, options);
        let mut reply = HeapReply::new();
        let fresh = cull(objects, options, &mut reply);
        assert_eq!(frame.pairs, pairs(objects.len(), &fresh, reply.words()));
        let (report, expected) = (&frame.answer.report, &fresh.report);
        assert_eq!((report.census, report.pair_count), (expected.census, expected.pair_count));
        if let EncodingChoice::Only(encoding) = options.encoding {
            assert_eq!(report.shape.encoding(), encoding);
        }
        assert!(options.readable.contains(report.shape.encoding()));
        let (meter, n) = (&report.skipped, objects.len() as u64);
        assert_eq!(meter.why.total(), meter.pairs);
        if meter.is_repeat() {
            assert_eq!((meter.boxes, meter.pairs), (n, n * (n - 1) / 2));
            assert_eq!(options.engine, EngineChoice::Auto);
        }
        meter.is_repeat()
    }
}

fn grid(n: usize) -> Vec<Aabb> {
    let at = |i: usize| Aabb::from([i as f32, 0.0, -0.0, i as f32 + 1.0, 1.0, 1.0]);
    (0..n).map(at).collect()
}

fn boxes_of(boxes: &[Aabb]) -> Objects<'_> {
    Objects::Boxes(boxes.into())
}

#[test]
fn the_third_equal_frame_is_not_culled() {
    for n in [2, 3, 66, 67, 1_000] {
        let boxes = grid(n);
        let mut client = Client::default();
        let repeats = [(); 5].map(|()| client.checked(boxes_of(&boxes), &CullOptions::default()));
        assert_eq!(repeats, [false, false, true, true, true], "{n} boxes");
    }
    for n in [0, 1] {
        let boxes = grid(n);
        let mut client = Client::default();
        assert!((0..5).all(|_| !client.checked(boxes_of(&boxes), &CullOptions::default())));
    }
}

#[test]
fn one_bit_of_one_box_is_noticed() {
    let n = 1_000;
    let options = CullOptions::default();
    for (at, change) in
        [(n - 1, 1), (n - 1, 1 << 31), (0, 1), (501, 1), (502, 1 << 31), (777, 0x7fc0_0000)]
    {
        for component in 0..6 {
            let mut boxes = grid(n);
            let mut client = Client::default();
            for _ in 0..3 {
                client.frame(boxes_of(&boxes), &options);
            }
            assert!(client.checked(boxes_of(&boxes), &options), "equal frames are answered again");
            let numbers: &mut [u32] = bytemuck::cast_slice_mut(&mut boxes[at..=at]);
            numbers[component] ^= change;
            assert!(!client.checked(boxes_of(&boxes), &options), "{at} {component} {change:x}");
        }
    }
}

#[test]
fn equal_nans_are_equal_and_zeros_of_two_signs_are_not() {
    let mut boxes = grid(100);
    boxes[50].max[1] = f32::NAN;
    let (mut client, options) = (Client::default(), CullOptions::default());
    let repeats = [(); 3].map(|()| client.checked(boxes_of(&boxes), &options));
    assert_eq!(repeats, [false, false, true]);
    boxes[51].min[1] = -0.0;
    assert!(!client.checked(boxes_of(&boxes), &options));
}

#[test]
fn a_box_that_moves_outside_of_the_sample_costs_few_copies() {
    let mut boxes = grid(1_000);
    let (mut client, options) = (Client::default(), CullOptions::default());
    let mut copies = 0;
    for i in 0..500 {
        boxes[500].max[0] = 501.0 + i as f32 / 1024.0;
        client.frame(boxes_of(&boxes), &options);
        copies += usize::from(client.repeats.promised.is_some());
    }
    assert!((1..=10).contains(&copies), "{copies}");
    assert_eq!(client.repeats.allocated_bytes(), 0);
}

#[test]
fn other_options_and_forms_are_other_frames() {
    let boxes = grid(300);
    let mut halves = vec![0u32; 3 * boxes.len()];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut halves);
    Encoder::new(&Precision::F16).write(&boxes, bytes);
    let spheres: Vec<Sphere> =
        boxes.iter().map(|b| Sphere::new([b.min[0], b.min[1], b.min[2]], 1.0)).collect();
    let narrow = Objects::Boxes(BoxSlice::new(BoxForm::F16, bytes).expect("halves"));
    let open = CullOptions::default();
    let others = [
        (boxes_of(&boxes), open),
        (boxes_of(&boxes[..299]), open),
        (narrow, open),
        (Objects::Spheres(&spheres), open),
        (boxes_of(&boxes), CullOptions { encoding: EncodingChoice::Only(Encoding::Dense), ..open }),
        (boxes_of(&boxes), CullOptions { visit_threads: Some(2), ..open }),
        (boxes_of(&boxes), CullOptions { readable: ReadableEncodings::at_minor(2), ..open }),
    ];
    for (i, before) in others.iter().enumerate() {
        for (j, after) in others.iter().enumerate() {
            let mut client = Client::default();
            let repeats = [(); 3].map(|()| client.checked(before.0, &before.1));
            assert_eq!(repeats, [false, false, true], "{i}");
            assert_eq!(client.checked(after.0, &after.1), i == j, "{i} {j}");
        }
    }
}

#[test]
fn a_named_engine_always_works() {
    let boxes = grid(100);
    let mut client = Client::default();
    let engine = EngineChoice::Only(EngineName::CpuGrid);
    let options = CullOptions { engine, ..CullOptions::default() };
    assert!((0..5).all(|_| !client.checked(boxes_of(&boxes), &options)));
    // Threads and what is known of the last frame do not make another frame.
    let open = CullOptions::default();
    for i in 0..5 {
        let options = CullOptions { threads: Some(1 + i % 2), last_pairs: Some(i as u64), ..open };
        assert_eq!(client.checked(boxes_of(&boxes), &options), i >= 2);
    }
    client.repeats.forget();
    assert_eq!(client.repeats.allocated_bytes(), 0);
    assert!(!client.checked(boxes_of(&boxes), &open));
}

#[test]
fn an_answer_that_was_never_kept_is_asked_for_again() {
    let boxes = grid(100);
    let (mut client, open) = (Client::default(), CullOptions::default());
    client.frame(boxes_of(&boxes), &open);
    assert_eq!(client.repeats.look(boxes_of(&boxes), &open, &mut client.reply), Seen::Alike);
    let ticket = client.repeats.ticket().expect("a small frame");
    let look =
        |client: &mut Client| client.repeats.look(boxes_of(&boxes), &open, &mut client.reply);
    assert_eq!(look(&mut client), Seen::New, "the frame is under way");
    drop(ticket);
    assert_eq!(look(&mut client), Seen::Alike);
    // A ticket of another frame, or an answer that is not in the reply, keeps nothing.
    let answer = cull(boxes_of(&boxes), &open, &mut client.reply);
    client.repeats.ticket().expect("small").keep(boxes_of(&boxes), &[], &answer);
    assert_eq!(look(&mut client), Seen::Alike);
    let words = client.reply.words().to_vec();
    client.repeats.ticket().expect("small").keep(boxes_of(&boxes[1..]), &words, &answer);
    assert_eq!(look(&mut client), Seen::Alike);
}

/// What changes between two frames.
#[derive(Clone, Debug)]
enum Step {
    /// So many equal frames.
    Again(usize),
    /// A bit of a component of a box.
    Bit {
        at: prop::sample::Index,
        component: usize,
        bit: u32,
    },
    /// A bit of the first box, which is in the sample.
    First {
        bit: u32,
    },
    /// The number of boxes.
    Count(usize),
    Options {
        encoding: usize,
        engine: bool,
        visit_threads: Option<usize>,
    },
    /// The scene of some frames ago.
    Back,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (1usize..5).prop_map(Step::Again),
        4 => (any::<prop::sample::Index>(), 0usize..6, 0u32..32)
            .prop_map(|(at, component, bit)| Step::Bit { at, component, bit }),
        1 => (0u32..32).prop_map(|bit| Step::First { bit }),
        1 => (0usize..200).prop_map(Step::Count),
        1 => (0usize..4, prop::bool::weighted(0.2), prop::option::of(1usize..3)).prop_map(
            |(encoding, engine, visit_threads)| Step::Options { encoding, engine, visit_threads }
        ),
        1 => Just(Step::Back),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_frames_have_the_answers_of_fresh_engines(
        steps in proptest::collection::vec(step(), 1..40),
    ) {
        let mut client = Client::default();
        let mut boxes = grid(150);
        let mut options = CullOptions::default();
        let mut earlier = boxes.clone();
        for step in steps {
            let mut frames = 1;
            match step {
                Step::Again(count) => frames = count,
                Step::Bit { at, component, bit } => {
                    if !boxes.is_empty() {
                        let at = at.index(boxes.len());
                        let numbers: &mut [u32] = bytemuck::cast_slice_mut(&mut boxes[at..=at]);
                        numbers[component] ^= 1 << bit;
                    }
                }
                Step::First { bit } => {
                    if let Some(first) = boxes.first_mut() {
                        first.min[0] = f32::from_bits(first.min[0].to_bits() ^ 1 << bit);
                    }
                }
                Step::Count(n) => {
                    earlier.clone_from(&boxes);
                    boxes = grid(n);
                }
                Step::Options { encoding, engine, visit_threads } => {
                    options.encoding = Encoding::ALL
                        .get(encoding)
                        .map_or(EncodingChoice::Auto, |e| EncodingChoice::Only(*e));
                    options.engine = if engine {
                        EngineChoice::Only(EngineName::CpuSap)
                    } else {
                        EngineChoice::Auto
                    };
                    options.visit_threads = visit_threads;
                }
                Step::Back => std::mem::swap(&mut boxes, &mut earlier),
            }
            for _ in 0..frames {
                client.checked(boxes_of(&boxes), &options);
            }
        }
    }
}
