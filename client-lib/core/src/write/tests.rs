use proptest::prelude::*;

use super::*;
use crate::aabb::BoxClass;
use crate::isa::Isa;
use crate::update::{Placement, Transformed, world_box};

/// Sizes around the groups, lines, staged boxes and tasks, and odd ones.
fn sizes() -> impl Iterator<Item = usize> {
    (0..=70).chain([345, 1023, 1025, 1234, way::COPIED_TASK_BOXES + 1, 40_003])
}

/// Any f32, with those that matter more often.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => any::<u32>().prop_map(f32::from_bits),
        2 => -1e3f32..1e3,
        1 => prop::sample::select(vec![
            0.0, -0.0, 1e-45, -1e-45, f32::MIN_POSITIVE, f32::MAX, f32::MIN, f32::INFINITY,
            f32::NEG_INFINITY, f32::NAN,
        ]),
    ]
}

fn point() -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(number())
}

/// Points that repeat after a prime number, so that no two neighbouring groups are alike.
fn points(n: usize, scale: f32) -> Vec<[f32; 3]> {
    (0..n).map(|i| [1, 2, 3].map(|k| (i * k % 9973) as f32 * scale - 7.0)).collect()
}

fn columns(points: &[[f32; 3]]) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect())
}

fn lend(columns: &[Vec<f32>; 3]) -> Columns<'_> {
    columns.each_ref().map(Vec::as_slice)
}

/// The bits of boxes, every NaN the same.
fn bits(boxes: &[Aabb]) -> Vec<[u32; 6]> {
    let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    boxes.iter().map(|b| <[f32; 6]>::from(*b).map(bits)).collect()
}

/// All ways to write `n` boxes.
fn ways(n: usize) -> impl Iterator<Item = (Way, AvailableIsa)> {
    let isas: Vec<_> = Isa::ALL.into_iter().filter_map(AvailableIsa::new).collect();
    [Stores::Cached, Stores::Streaming].into_iter().flat_map(move |stores| {
        let ways = [n, 40, 1000].map(|part_boxes| Way { stores, part_boxes });
        let isas = isas.clone();
        ways.into_iter().flat_map(move |way| isas.clone().into_iter().map(move |isa| (way, isa)))
    })
}

/// What [`Aabb::default`] never is: shows boxes that were not written, and boxes written beside.
const UNTOUCHED: Aabb = Aabb { min: [123.0; 3], max: [-321.0; 3] };

/// Writes in all ways, at every offset from a cache line, and compares with `expected`.
fn check<S: BoxSource + Sync + ?Sized>(name: &str, source: &S, expected: &[Aabb]) {
    let (n, expected) = (expected.len(), bits(expected));
    for (way, isa) in ways(n) {
        for offset in 0..3 {
            let mut memory = vec![UNTOUCHED; n + offset + 1];
            way.write(source, &mut memory[offset..][..n], isa);
            assert_eq!(bits(&memory[offset..][..n]), expected, "{name}, {n}, {way:?}, {isa:?}");
            assert!(memory[..offset].iter().all(|b| *b == UNTOUCHED), "{name}, {n}: before");
            assert_eq!(memory[offset + n], UNTOUCHED, "{name}, {n}: behind");
        }
    }
    let mut memory = vec![UNTOUCHED; n];
    write_boxes(source, &mut memory);
    assert_eq!(bits(&memory), expected, "{name}, {n}, one thread");
    memory.fill(UNTOUCHED);
    par_write_boxes(source, &mut memory);
    assert_eq!(bits(&memory), expected, "{name}, {n}, the pool");
}

/// Checks every source that a pair of points for each box can be given by.
fn check_all(first: &[[f32; 3]], second: &[[f32; 3]]) {
    let pairs = || first.iter().copied().zip(second.iter().copied());
    let boxes: Vec<Aabb> = pairs().map(Aabb::from).collect();
    check("boxes", boxes.as_slice(), &boxes);
    check("vec", &boxes, &boxes);
    let (a, b) = (columns(first), columns(second));
    check("corners in columns", &MinMax::columns(lend(&a), lend(&b)), &boxes);
    check("corners as points", &MinMax::points(first, second), &boxes);
    let around: Vec<Aabb> = pairs().map(|(c, h)| Aabb::from_center_half(c, h)).collect();
    check("centres in columns", &CenterHalf::columns(lend(&a), lend(&b)), &around);
    check("centres as points", &CenterHalf::points(first, second), &around);
    let vectors = |points: &[[f32; 3]]| -> Vec<glam::Vec3A> {
        points.iter().map(|p| glam::Vec3A::from_array(*p)).collect()
    };
    check("padded vectors", &CenterHalf::points(&vectors(first), &vectors(second)), &around);
    let placed: Vec<_> =
        second.iter().map(|p| Placement { translation: *p, ..Placement::IDENTITY }).collect();
    let world: Vec<_> = boxes.iter().zip(&placed).map(|(b, p)| world_box(b, p)).collect();
    check("transforms", &Transformed::new(&boxes, &placed), &world);
}

#[test]
fn every_source_and_way_writes_the_boxes_of_a_plain_loop() {
    for n in sizes() {
        check_all(&points(n, 0.37), &points(n, 0.0013));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_numbers(pairs in prop::collection::vec((point(), point()), 0..100)) {
        let (first, second): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
        check_all(&first, &second);
    }
}

#[test]
fn a_wrong_box_is_noticed() {
    let boxes = points(50, 1.0).into_iter().map(|p| Aabb::new(p, p)).collect::<Vec<_>>();
    for at in [0, 7, 31, 32, 49] {
        let mut wrong = boxes.clone();
        wrong[at].max[2] = wrong[at].max[2].next_up();
        let compared = std::panic::catch_unwind(|| check("boxes", &boxes, &wrong));
        assert!(compared.is_err(), "box {at}");
    }
}

#[test]
fn extents_that_are_no_sizes_give_the_classes_that_are_documented() {
    let class = |center: f32, half: f32| {
        let mut out = [UNTOUCHED];
        write_boxes(&CenterHalf::points(&[[0.0, center, 0.0]], &[[1.0, half, 1.0]]), &mut out);
        out[0].class()
    };
    let infinity = f32::INFINITY;
    for (center, half, expected) in [
        (1.0, 0.0, BoxClass::Valid),
        (1.0, -0.5, BoxClass::Empty),
        (1e9, -1.0, BoxClass::Valid),
        (f32::NAN, 1.0, BoxClass::Invalid),
        (1.0, f32::NAN, BoxClass::Invalid),
        (infinity, 1.0, BoxClass::Valid),
        (infinity, infinity, BoxClass::Invalid),
        (1.0, infinity, BoxClass::Valid),
        (1.0, -infinity, BoxClass::Empty),
    ] {
        assert_eq!(class(center, half), expected, "{center} ± {half}");
    }
}

#[test]
fn lengths_must_agree() {
    fn panics<R>(work: fn() -> R) -> bool {
        std::panic::catch_unwind(work).is_err()
    }
    assert!(!panics(|| CenterHalf::columns([&[0.0]; 3], [&[0.0]; 3])));
    assert!(panics(|| CenterHalf::columns([&[0.0]; 3], [&[0.0], &[], &[0.0]])));
    assert!(panics(|| MinMax::columns([&[0.0], &[0.0], &[]], [&[0.0]; 3])));
    assert!(!panics(|| MinMax::points(&[[0.0; 3]], &[[1.0; 3]])));
    assert!(panics(|| MinMax::points(&[[0.0; 3]], &[])));
    assert!(panics(|| CenterHalf::points(&[], &[[1.0; 3]])));
    assert!(panics(|| Transformed::new(&[Aabb::EMPTY], &[] as &[Placement]).len()));
    assert!(panics(|| write_boxes(&[Aabb::EMPTY; 2], &mut [Aabb::EMPTY; 3])));
    assert!(panics(|| par_write_boxes(&[Aabb::EMPTY; 4], &mut [Aabb::EMPTY; 3])));
}

#[test]
fn a_source_that_panics_leaves_memory_that_can_be_read() {
    struct Half;
    impl BoxSource for Half {
        fn len(&self) -> usize {
            1000
        }
        fn write_range(&self, first: usize, out: &mut [Aabb]) {
            assert!(first < 500, "as the test needs");
            out.fill(Aabb::EMPTY);
        }
    }
    let mut out = vec![UNTOUCHED; 1000];
    let way = Way { stores: Stores::Streaming, part_boxes: 1000 };
    let write = std::panic::AssertUnwindSafe(|| way.write(&Half, &mut out, AvailableIsa::best()));
    assert!(std::panic::catch_unwind(write).is_err());
    assert_eq!(out[..480], [Aabb::EMPTY; 480]);
    assert_eq!(out[999], UNTOUCHED);
}

#[test]
fn the_choice_depends_on_size_and_threads() {
    let streamed = way::STREAMED_BYTES.div_ceil(crate::aabb::AABB_BYTES);
    let of = Way::of::<[Aabb]>;
    assert_eq!(of(streamed - 1, 1).stores, Stores::Cached);
    assert_eq!(of(streamed, 1), Way { stores: Stores::Streaming, part_boxes: streamed });
    assert_eq!(of(usize::MAX, 1).part_boxes, usize::MAX);
    assert_eq!(of(0, 8).part_boxes, 1);
    for (n, parts) in [(1, 1), (16_384, 1), (16_385, 2), (100_000, 7), (1_000_000, 62)] {
        let part_boxes = of(n, 8).part_boxes;
        assert_eq!(n.div_ceil(part_boxes), parts, "{n}");
        assert!(parts == 1 || part_boxes.is_multiple_of(8), "{n}: parts end on cache lines");
    }
}
