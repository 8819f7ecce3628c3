//! Whole frames with random rules, and the pairs that they have by the naive model of scenes.

use std::sync::Arc;

use pairmask::{FrameOptions, PairMask, Pending, Session};
use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData, FilterId, FilterTable, Owner, Rules, World};
use pairmask_core::oracle::{self, Pair};

use crate::frames::{Frames, filtered};
use crate::scene_model::{Model, Op};
use crate::stress_scenes::Rng;

#[derive(Clone, Copy, Debug)]
pub struct Kind {
    worlds: &'static [i32],
    filters: u32,
    lists: bool,
}

pub const KINDS: [Kind; 9] = [
    Kind { worlds: &[0], filters: 70, lists: false },
    Kind { worlds: &[0], filters: 15, lists: false },
    Kind { worlds: &[7, -1], filters: 12, lists: true },
    Kind { worlds: &[0, 1, 2], filters: 0, lists: false },
    Kind { worlds: &[3, -1, 9, 9, 9, -4], filters: 0, lists: false },
    Kind { worlds: &[3, 3, -1, 9, i32::MIN, i32::MAX], filters: 9, lists: true },
    Kind { worlds: &[0, 1, 1, 1, 1, 1, 1, 1, 1, 1], filters: 70, lists: false },
    Kind { worlds: &[-1], filters: 0, lists: true },
    Kind { worlds: &[5], filters: 3, lists: false },
];

#[derive(Clone, Debug)]
pub struct FilteredFrame {
    pub boxes: Vec<Aabb>,
    pub rules: Rules,
    pub pairs: Vec<Pair>,
}

impl FilteredFrame {
    /// A frame of `n` boxes, some empty or invalid, with rules of a kind.
    pub fn drawn(n: usize, kind: Kind, seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let boxes = drawn_boxes(n, &mut rng);
        let mut ops: Vec<Op> = (0..).zip(&boxes).map(|(index, b)| Op::Set(index, *b)).collect();
        let filters: Vec<Filter> = (0..kind.filters)
            .map(|_| {
                Filter::new(u64::from(rng.below(8)), u64::from(rng.below(8) | 1))
                    .with_group(rng.below(3) as i32 - 1)
                    .with_static(rng.below(6) == 0)
                    .with_either(rng.below(2) == 0)
            })
            .collect();
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&filters).expect("few filters");
        ops.push(Op::Filters(filters));
        // The last boxes have the usual filter data, and some name a filter that is not in the table.
        for index in 0..(n - n / 9) as u32 {
            let world = World(kind.worlds[rng.below(kind.worlds.len() as u32) as usize]);
            let mut filter_data = FilterData::default().with_world(world);
            if kind.filters > 0 {
                let filter = FilterId(rng.below(kind.filters + 1) as u16);
                filter_data = FilterData::new(world, Owner(rng.below(5)), filter);
                filter_data = filter_data.with_static(rng.below(7) == 0);
            }
            rules.filter_data.push(filter_data);
            // In a frame filter data says whether its box is static, in a scene a step does.
            ops.extend([
                Op::FilterData(index, filter_data),
                Op::Static(index, filter_data.is_static()),
            ]);
        }
        rules.filter_data.resize(n, FilterData::default());
        for _ in 0..if kind.lists && n > 1 { n } else { 0 } {
            let [a, b] = [0; 2].map(|_| rng.below(n as u32));
            let pair = [a.min(b), a.max(b)];
            if rng.below(2) == 0 {
                rules.lists.include(pair, true);
                ops.push(Op::Include(pair, true));
            } else {
                rules.lists.exclude(pair, true);
                ops.push(Op::Exclude(pair, true));
            }
        }
        let mut model = Model::default();
        model.apply(0, &ops);
        let pairs = model.pairs().into_keys().collect();
        Self { boxes, rules, pairs }
    }

    /// Its pairs by the oracle and the rules, after these were changed.
    pub fn find_pairs(&mut self) {
        self.pairs = oracle::truth(&self.boxes).pairs;
        self.pairs.retain(|[a, b]| self.rules.meet(*a, *b));
    }

    /// Its rules, which no daemon has kept.
    pub fn options(&self) -> FrameOptions {
        filtered(&Arc::new(self.rules.clone()))
    }

    pub fn submit(&self, session: &mut Session) -> Pending<PairMask> {
        session.ask_with(&self.boxes, &self.options())
    }
}

fn drawn_boxes(n: usize, rng: &mut Rng) -> Vec<Aabb> {
    let side = (n as f64).cbrt().ceil() as u32 * 2 + 4;
    let mut corner = || [0; 3].map(|_| rng.below(side * 16) as f32 / 16.0);
    let mut boxes: Vec<Aabb> =
        (0..n).map(|_| corner()).map(|low| Aabb::new(low, low.map(|x| x + 2.5))).collect();
    for (at, b) in boxes.iter_mut().enumerate() {
        match at % 37 {
            11 => *b = Aabb::EMPTY,
            23 => b.min[1] = f32::NAN,
            _ => {}
        }
    }
    boxes
}
