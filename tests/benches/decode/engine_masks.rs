//! Masks that an engine made of a scene: the same pairs as sparse mask, as list, and as neighbours
//! (a form that was measured and not taken). Cold: many copies are visited in turn, so that each comes
//! from memory or from a cache that others share.

use pairmask_core::engine::{CullInput, Engine, Grid, HeapReply};
use pairmask_core::mask::{MaskShape, MaskView};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmaskd::scene::{self, SceneName};

use crate::neighbours::Neighbours;
use crate::{by_named_kernel, median_of};

/// A name, and boxes by their number.
type Scene = (&'static str, fn(usize) -> Vec<Aabb>);

const SCENES: [Scene; 6] = [
    ("uniform", |n| named(SceneName::Uniform, n)),
    ("mixed", |n| named(SceneName::Mixed, n)),
    ("pile", |n| named(SceneName::Pile, n)),
    ("plane", |n| named(SceneName::Plane, n)),
    ("torus", |n| named(SceneName::Torus, n)),
    ("crowd", crowd),
];

/// Numbers of boxes.
const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];

/// Bytes of all copies: several times what the third-level caches of today's machines hold for one core.
const COLD_BYTES: usize = 192 << 20;

/// Most copies of a small mask.
const MOST_COPIES: usize = 256;

/// A box in ten is one of a group of 64 that all overlap each other.
fn crowd(n: usize) -> Vec<Aabb> {
    let mut boxes = named(SceneName::Uniform, n);
    for (i, b) in boxes.iter_mut().take(n / 10).enumerate() {
        let at = (i / 64) as f32 * 3.0;
        *b = Aabb::from([at, -9.0, -9.0, at + 1.0, -8.0, -8.0]);
    }
    boxes
}

fn named(name: SceneName, n: usize) -> Vec<Aabb> {
    scene::Scene::new(name, n, 1).boxes().to_vec()
}

/// Prints a row for each scene and size whose title has the filter in it.
pub fn run(filter: &str) {
    println!("\n{:44}{:>26}{:>36}{:>27}", "", "bytes a pair", "ns a pair: for_each", "by slices");
    let columns = ["sparse", "list", "neighb.", "sparse", "list", "neighb.", "read"];
    print!("{:32} {:>10}", "cold, one thread", "pairs");
    for column in columns.into_iter().chain(["sparse", "list", "neighb."]) {
        print!(" {column:>8}");
    }
    println!();
    for (name, boxes) in SCENES {
        for n in SIZES {
            let title = format!("engine, {name}, n = {n}");
            if title.contains(filter) {
                row(&title, &boxes(n));
            }
        }
    }
}

fn row(title: &str, boxes: &[Aabb]) {
    let n = BoxCount::new(boxes.len() as u32);
    let sparse = Copies::of_engine(n, boxes, Encoding::Sparse);
    let list = Copies::of_engine(n, boxes, Encoding::List);
    let by_box = Neighbours::of(&sparse.view(0)).into_words();
    // The shape is not looked at: no encoding has this form.
    let neighbours = Copies::new(n, MaskShape::list(0), by_box);
    let pairs = list.view(0).count();
    let bytes =
        [sparse.shape.mask_bytes(), list.shape.mask_bytes(), 4 * neighbours.all[0].len() as u64];
    let times = [
        sparse.cold_ns(|view, _| sum_of_each(view)),
        list.cold_ns(|view, _| sum_of_each(view)),
        neighbours.cold_ns(|_, words| {
            let mut sum = 0;
            Neighbours::view(n, words).for_each(|a, b| sum += u64::from(a ^ b));
            sum
        }),
        list.cold_ns(|_, words| u64::from(words.iter().fold(0, |or, word| or | word))),
        sparse.cold_ns(|view, _| sum_of_slices(view)),
        list.cold_ns(|view, _| sum_of_slices(view)),
        neighbours.cold_ns(|_, words| {
            let mut sum = 0;
            Neighbours::view(n, words).for_each_group(|a, partners| {
                sum += partners.iter().map(|b| u64::from(a ^ b)).sum::<u64>();
            });
            sum
        }),
    ];
    print!("{title:32} {pairs:>10}");
    for value in bytes.map(|bytes| bytes as f64).into_iter().chain(times) {
        print!(" {:>8.2}", value / pairs as f64);
    }
    println!();
}

fn sum_of_each(mask: &MaskView<'_>) -> u64 {
    let mut sum = 0;
    mask.for_each(|a, b| sum += u64::from(a ^ b));
    sum
}

fn sum_of_slices(mask: &MaskView<'_>) -> u64 {
    let mut sum = 0;
    mask.for_each_slice(|pairs| sum += pairs.iter().map(|[a, b]| u64::from(a ^ b)).sum::<u64>());
    sum
}

/// Copies of one reply.
struct Copies {
    n: BoxCount,
    shape: MaskShape,
    all: Vec<Vec<u32>>,
}

impl Copies {
    fn of_engine(n: BoxCount, boxes: &[Aabb], encoding: Encoding) -> Self {
        let mut reply = HeapReply::new();
        let input = CullInput::boxes(boxes).encoding(encoding);
        let report = Grid::new().cull(&input, &mut reply).expect("memory for the mask");
        Self::new(n, report.shape, reply.words().to_vec())
    }

    fn new(n: BoxCount, shape: MaskShape, words: Vec<u32>) -> Self {
        let count = (COLD_BYTES / (4 * words.len()).max(1)).clamp(2, MOST_COPIES);
        Self { n, shape, all: vec![words; count] }
    }

    fn view(&self, copy: usize) -> MaskView<'_> {
        let mask = MaskView::new(self.n, &self.shape, &self.all[copy]);
        let mask = mask.expect("the engine's own shape");
        by_named_kernel(mask).unwrap_or(mask)
    }

    /// Median time of a visit, ns, each of another copy than the last.
    fn cold_ns(&self, visit: impl Fn(&MaskView<'_>, &[u32]) -> u64) -> f64 {
        let mut copy = 0;
        let time = median_of(|| {
            copy = (copy + 1) % self.all.len();
            visit(&self.view(copy), &self.all[copy])
        });
        time.as_secs_f64() * 1e9
    }
}
