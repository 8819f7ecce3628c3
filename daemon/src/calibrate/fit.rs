//! The fit: from measured times to the constants of the plan's cost model.
//!
//! The model is linear ([`Work`]), so one robust least-squares fit of relative errors gives all
//! constants at once. Two rules keep it robust on a busy machine. Constants start from those of a
//! known machine, scaled by how much faster or slower this one is, and stay near them where no
//! measurement says otherwise. A row that fits badly counts less.

use pairmask_core::Encoding;
use pairmask_core::engine::EngineName;
use pairmask_core::plan::{Calibration, SceneStats, Term, ThreadCost, Work};

use super::case::{Case, CaseTimes};
use super::timed_way::Way;

/// The extra time that another mask takes the engine over a sparse one of the same frame is a row of
/// its own, relative to this share of the engine's time: beside the whole of it, it would vanish in
/// that one's errors.
const MASK_SHARE: f64 = 0.2;
/// Terms of the model.
const TERMS: usize = Term::ALL.len();
/// Weight of the start constants, in rows of measurements: low, but above zero.
const PRIOR_ROWS: f64 = 0.1;
/// A constant stays within this factor of its start, up and down.
const PRIOR_FACTOR: f64 = 8.0;
/// A relative error above this counts as noise: linearly, not squared (Huber).
const NOISE: f64 = 0.15;
/// Rounds of weighting rows, and of descent along each constant within a round.
const ROUNDS: usize = 12;
const DESCENTS: usize = 2_000;
/// Fewest boxes of a row for the fit of threads: below, engines use one thread however many they
/// may.
const THREADED_BOXES: usize = 4_096;

/// The part of a frame that a row measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramePart {
    /// The engine's: from boxes to mask.
    Cull,
    /// The client's: from the mask to each pair, on as many threads as the engine has.
    Visit,
}

/// One measured time and its inputs.
#[derive(Clone, Copy, Debug)]
pub struct FitRow {
    /// The case.
    pub case: Case,
    /// The way.
    pub way: Way,
    /// What of the frame.
    pub part: FramePart,
    /// The plan's statistics.
    pub stats: SceneStats,
    /// The shortest time, ns.
    pub measured_ns: f64,
}

impl FitRow {
    fn work(&self) -> Option<Work> {
        let Way { engine, encoding, .. } = self.way;
        match self.part {
            FramePart::Cull => Work::of(engine, encoding, &self.stats),
            FramePart::Visit => Some(Work::of_visit(engine, encoding, &self.stats)),
        }
    }

    /// The time that a calibration predicts, ns.
    pub fn predicted_ns(&self, calibration: &Calibration) -> f64 {
        let one_ns = self.work().map_or(0.0, |work| calibration.time_ns(&work));
        let threads = match self.part {
            FramePart::Cull => calibration.threads_of(self.way.engine),
            FramePart::Visit => calibration.visit_threads,
        };
        threads.on(self.way.threads, one_ns)
    }

    /// Whose work it is: an engine's; `None` for the client's.
    fn owner(&self) -> Option<EngineName> {
        (self.part == FramePart::Cull).then_some(self.way.engine)
    }
}

/// The rows of measured cases.
pub fn rows(cases: &[CaseTimes]) -> Vec<FitRow> {
    let rows = cases.iter().flat_map(|measured| {
        measured.ways.iter().flat_map(|(way, times)| {
            let parts = [
                (FramePart::Cull, times.least_engine_ns()),
                (FramePart::Visit, times.least_visit_ns()),
            ];
            parts.map(|(part, ns)| FitRow {
                case: measured.case,
                way: *way,
                part,
                stats: measured.stats,
                measured_ns: ns as f64,
            })
        })
    });
    rows.filter(|row| row.measured_ns > 0.0).collect()
}

/// Fits the constants to rows, beginning from `start`.
pub fn fit(rows: &[FitRow], start: &Calibration) -> Calibration {
    let scaled = scale(rows, start);
    let ns = fit_terms(rows, &scaled.ns);
    let fitted = Calibration { ns, ..scaled };
    let threads =
        EngineName::CPU.map(|engine| fit_threads(rows, Some(engine), start.threads_of(engine)));
    let visit_threads = fit_threads(rows, None, start.visit_threads);
    Calibration { threads, visit_threads, ..fitted }
}

/// The constants of `start`, each engine's multiplied by the ratio of its measured times to its
/// predicted ones, and those of masks by that of visiting them: enough after a short measurement.
pub fn scale(rows: &[FitRow], start: &Calibration) -> Calibration {
    let ratio_of = |wanted: &dyn Fn(&FitRow) -> bool| {
        let rows = rows.iter().filter(|row| row.way.threads == 1 && wanted(row));
        median(rows.map(|row| row.measured_ns / row.predicted_ns(start)).collect())
    };
    let all = ratio_of(&|_| true).unwrap_or(1.0);
    let mut calibration = *start;
    for term in Term::ALL {
        let ratio = ratio_of(&|row| row.owner() == term.owner()).unwrap_or(all);
        calibration.ns[term.index()] *= ratio;
    }
    calibration
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The constants of the terms; relative to `start` during the fit.
fn fit_terms(rows: &[FitRow], start: &[f64; TERMS]) -> [f64; TERMS] {
    let singles: Vec<&FitRow> = rows.iter().filter(|row| row.way.threads == 1).collect();
    let equation = |row: &&FitRow| match (row.part, row.way.encoding) {
        (FramePart::Visit, _) | (_, Encoding::Sparse) => Equation::of_part(row, start),
        (FramePart::Cull, _) => {
            let sparse = Way { encoding: Encoding::Sparse, ..row.way };
            let mut culls = singles.iter().filter(|row| row.part == FramePart::Cull);
            let twin = culls.find(|twin| twin.case == row.case && twin.way == sparse)?;
            Equation::of_masks(row, twin, start)
        }
    };
    let equations: Vec<Equation> = singles.iter().filter_map(equation).collect();
    let mut x = [1.0; TERMS];
    for _ in 0..ROUNDS {
        let weights: Vec<f64> = equations.iter().map(|e| weight(e.error(&x))).collect();
        descend(&equations, &weights, &mut x);
    }
    std::array::from_fn(|t| start[t] * x[t])
}

/// The sum of share[t] · x[t] is `target`, where x = 1 is the start. An error of 1 is as bad as a
/// prediction of twice the time.
struct Equation {
    share: [f64; TERMS],
    target: f64,
}

impl Equation {
    /// The equation that a part of a frame takes its measured time.
    fn of_part(row: &FitRow, start: &[f64; TERMS]) -> Option<Self> {
        let work = row.work()?;
        let share = |t: usize| work.amounts()[t] * start[t] / row.measured_ns;
        Some(Self { share: std::array::from_fn(share), target: 1.0 })
    }

    /// The equation of the extra time that a mask takes its engine over a sparse one of the frame.
    fn of_masks(other: &FitRow, sparse: &FitRow, start: &[f64; TERMS]) -> Option<Self> {
        let (more, less) = (other.work()?, sparse.work()?);
        let unit = MASK_SHARE * sparse.measured_ns;
        let share = |t: usize| (more.amounts()[t] - less.amounts()[t]) * start[t] / unit;
        let target = (other.measured_ns - sparse.measured_ns) / unit;
        Some(Self { share: std::array::from_fn(share), target })
    }

    fn error(&self, x: &[f64; TERMS]) -> f64 {
        dot(&self.share, x) - self.target
    }
}

/// Minimises the weighted squares of all rows and of the distance to the start, one constant after
/// the other.
fn descend(equations: &[Equation], weights: &[f64], x: &mut [f64; TERMS]) {
    let mut gram = [[0.0; TERMS]; TERMS];
    let mut target = [PRIOR_ROWS; TERMS];
    for (t, row) in gram.iter_mut().enumerate() {
        row[t] = PRIOR_ROWS;
    }
    for (Equation { share, target: wanted }, weight) in equations.iter().zip(weights) {
        for t in 0..TERMS {
            target[t] += weight * share[t] * wanted;
            for u in 0..TERMS {
                gram[t][u] += weight * share[t] * share[u];
            }
        }
    }
    for _ in 0..DESCENTS {
        for t in 0..TERMS {
            let others = dot(&gram[t], x) - gram[t][t] * x[t];
            x[t] = ((target[t] - others) / gram[t][t]).clamp(1.0 / PRIOR_FACTOR, PRIOR_FACTOR);
        }
    }
}

fn dot(a: &[f64; TERMS], b: &[f64; TERMS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Weight of a row whose relative error is `error`.
fn weight(error: f64) -> f64 {
    if error.abs() <= NOISE { 1.0 } else { NOISE / error.abs() }
}

/// The gain of an engine, or of the client, by threads: t = one · (s + (1 − s)/T) + f · (T − 1) for every row of T
/// threads beside the row of one.
fn fit_threads(rows: &[FitRow], owner: Option<EngineName>, start: ThreadCost) -> ThreadCost {
    let of_owner = || rows.iter().filter(|row| row.owner() == owner);
    let ones: Vec<&FitRow> = of_owner().filter(|row| row.way.threads == 1).collect();
    let more = of_owner().filter(|row| row.way.threads > 1 && row.case.n >= THREADED_BOXES);
    // (a, b, c): a · s + b · f = c, all divided by the measured time.
    let mut equations: Vec<[f64; 3]> = more
        .filter_map(|row| {
            let one_way = Way { threads: 1, ..row.way };
            let twin = |one: &&&FitRow| one.case == row.case && one.way == one_way;
            let one_ns = ones.iter().find(twin)?.measured_ns;
            let threads = row.way.threads as f64;
            let divided = row.measured_ns - one_ns / threads;
            let parallel = one_ns * (1.0 - 1.0 / threads);
            Some([parallel, threads - 1.0, divided].map(|x| x / row.measured_ns))
        })
        .collect();
    if equations.is_empty() {
        return start;
    }
    // The start constants as two rows of low weight, in the units of the other rows.
    equations.push([PRIOR_ROWS, 0.0, PRIOR_ROWS * start.serial_share]);
    equations.push([0.0, PRIOR_ROWS / start.fan_out_ns.max(1.0), PRIOR_ROWS]);
    let (mut s, mut f) = (start.serial_share, start.fan_out_ns);
    for _ in 0..ROUNDS {
        let weights: Vec<f64> =
            equations.iter().map(|[a, b, c]| weight(a * s + b * f - c)).collect();
        let sum = |of: fn(&[f64; 3]) -> f64| -> f64 {
            equations.iter().zip(&weights).map(|(row, weight)| weight * of(row)).sum()
        };
        let (aa, ab, bb) = (sum(|r| r[0] * r[0]), sum(|r| r[0] * r[1]), sum(|r| r[1] * r[1]));
        let (ac, bc) = (sum(|r| r[0] * r[2]), sum(|r| r[1] * r[2]));
        for _ in 0..DESCENTS {
            s = ((ac - ab * f) / aa.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            f = ((bc - ab * s) / bb.max(f64::MIN_POSITIVE)).max(0.0);
        }
    }
    ThreadCost { serial_share: s, fan_out_ns: f }
}

#[cfg(test)]
mod tests {
    use pairmask_core::BoxCount;
    use pairmask_core::engine::Isa;

    use super::*;
    use crate::scene::SceneName;

    /// Rows of a machine with the constants of `truth`, some of them disturbed.
    fn rows_of(truth: &Calibration, disturb: impl Fn(usize) -> f64) -> Vec<FitRow> {
        let mut rows = Vec::new();
        for n in [64, 128, 300, 1_000, 2_000, 4_096, 10_000, 30_000, 100_000] {
            for (window_share, large_size, elongation, pairs) in
                [(0.05, 1.0, 1.0, 1), (0.02, 20.0, 1.0, 2), (0.03, 1.0, 30.0, 7)]
            {
                for engine in EngineName::CPU {
                    for (encoding, threads) in [
                        (Encoding::Sparse, 1),
                        (Encoding::Dense, 1),
                        (Encoding::List, 1),
                        (Encoding::Sparse, 4),
                    ] {
                        let stats = SceneStats {
                            window_share,
                            large_size,
                            elongation,
                            ..SceneStats::unseen(BoxCount::new(n), Some(u64::from(pairs * n)))
                        };
                        let case =
                            Case { scene: SceneName::Uniform, n: n as usize * 8 + rows.len() / 24 };
                        let way = Way { engine, encoding, threads };
                        for part in [FramePart::Cull, FramePart::Visit] {
                            let mut row = FitRow { case, way, part, stats, measured_ns: 1.0 };
                            row.measured_ns = row.predicted_ns(truth) * disturb(rows.len());
                            rows.push(row);
                        }
                    }
                }
            }
        }
        rows
    }

    fn slow_machine() -> Calibration {
        let mut truth = Calibration::built_in(Isa::Avx512);
        for (t, ns) in truth.ns.iter_mut().enumerate() {
            *ns *= [2.5, 3.0, 2.0, 3.5][t % 4];
        }
        let threads = ThreadCost { serial_share: 0.3, fan_out_ns: 20_000.0 };
        truth.threads = [threads; EngineName::CPU.len()];
        truth.visit_threads = threads;
        truth
    }

    /// The median of the predictions' errors.
    fn median_ratio(rows: &[FitRow], calibration: &Calibration) -> f64 {
        let ratios = rows.iter().map(|row| row.predicted_ns(calibration) / row.measured_ns);
        median(ratios.map(|ratio| ratio.max(1.0 / ratio)).collect()).unwrap_or(f64::INFINITY)
    }

    fn worst_ratio(rows: &[FitRow], calibration: &Calibration) -> f64 {
        let ratios = rows.iter().map(|row| row.predicted_ns(calibration) / row.measured_ns);
        ratios.fold(1.0, |worst, ratio| worst.max(ratio).max(1.0 / ratio))
    }

    #[test]
    fn the_constants_of_a_slower_machine_are_found() {
        let truth = slow_machine();
        let rows = rows_of(&truth, |_| 1.0);
        let start = Calibration::built_in(Isa::Avx512);
        assert!(worst_ratio(&rows, &start) > 2.0, "the start is wrong");
        let found = fit(&rows, &start);
        let (half, all) = (median_ratio(&rows, &found), worst_ratio(&rows, &found));
        assert!(half < 1.05 && all < 1.5, "{half} {all} {found:?}");
    }

    #[test]
    fn rows_that_a_busy_machine_spoilt_count_little() {
        let truth = slow_machine();
        let spoilt = rows_of(&truth, |row| if row % 7 == 0 { 6.0 } else { 1.0 });
        let found = fit(&spoilt, &Calibration::built_in(Isa::Avx512));
        let clean = rows_of(&truth, |_| 1.0);
        let (half, all) = (median_ratio(&clean, &found), worst_ratio(&clean, &found));
        assert!(half < 1.15 && all < 2.0, "{half} {all} {found:?}");
    }

    #[test]
    fn without_rows_nothing_changes() {
        let start = Calibration::built_in(Isa::Avx2);
        let found = fit(&[], &start);
        for (found, start) in found.ns.iter().zip(&start.ns) {
            assert!((found / start - 1.0).abs() < 1e-9);
        }
        assert_eq!(found.threads, start.threads);
    }

    #[test]
    fn a_glance_scales_each_engine() {
        let start = Calibration::built_in(Isa::Avx512);
        let mut twice = start;
        for ns in &mut twice.ns {
            *ns *= 2.0;
        }
        let rows: Vec<_> =
            rows_of(&twice, |_| 1.0).into_iter().filter(|row| row.way.threads == 1).collect();
        for (found, wanted) in scale(&rows, &start).ns.iter().zip(&twice.ns) {
            assert!((found / wanted - 1.0).abs() < 1e-9);
        }
    }
}
