//! The subjects that take part: engines with instruction sets, encodings and thread counts, in every form.

use std::sync::Arc;

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineChoice, EngineName, HeapReply, Isa, cpu_engine,
};
use pairmask_core::oracle::check::{Mismatch, check_frame};
use pairmask_core::oracle::naive_decoder::decode;
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{Aabb, Encoding, EncodingChoice};
use pairmaskd::execute::gpu::{
    AllPairs, EngineOptions, Gpu, GpuChoice, GpuError, Grid, HostImport,
};
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::{Deserialize, Serialize};

use super::Subject;
use super::answer::{Answer, Finding, Form, Reply};
use super::case::Case;
use super::modes::{Sending, Usage};
use crate::Result;
use crate::sabotage::{Sabotage, Spoiler, lose_a_pair, shrink};
use crate::study::harness::open_if_any;
use crate::study::ways::distinct;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Requested {
    pub engines: Vec<String>,
    pub modes: Vec<String>,
    /// Most threads of an engine; each takes part with one thread as well.
    pub threads: usize,
}

impl Requested {
    pub const MODES: [&str; 7] = ["all", "exact", "q16", "q8", "f16", "margin", "f64"];

    pub fn engine_names() -> Vec<&'static str> {
        let engines = EngineName::ALL.iter().map(|name| name.as_str());
        ["all"].into_iter().chain(engines).chain(["spheres", "scenes"]).collect()
    }

    /// Whether an engine, or another kind of subjects, takes part in a form.
    pub fn has(&self, engine: &str, form: Form) -> bool {
        let names = |list: &[String], name| list.iter().any(|one| one == "all" || one == name);
        names(&self.engines, engine) && names(&self.modes, form.mode())
    }

    pub fn forms_of_boxes(&self, engine: &str) -> Vec<Form> {
        let forms = [Form::Boxes].into_iter().chain(Usage::ALL.map(Form::Mode));
        forms.filter(|form| self.has(engine, *form)).collect()
    }
}

#[derive(Clone, Debug)]
pub struct Roster {
    pub requested: Requested,
    /// The GPU. Engines of the GPU that no name asks for are left out on a machine without one.
    pub gpu: GpuChoice,
    /// Break every engine or mode, to test that the checks notice.
    pub sabotage: Option<Sabotage>,
}

/// Bytes of a band's matrix, so small that scenes of more than about 2,000 boxes have several bands:
/// 512 rows, the fewest that a band may have, of up to 8,192 boxes, more than any case has.
const SMALL_MATRIX_BYTES: u64 = 512 * (8_192 / 32) * 4;

/// Fills the second grid's new video memory: a word that no stage wrote must not reach an answer.
const POISON: u32 = 0xa5a5_a5a5;

impl Roster {
    pub fn subjects(&self) -> Result<Vec<Subject>> {
        let mut pools = Vec::new();
        for threads in distinct(vec![1, self.requested.threads.max(1)]) {
            pools.push(Arc::new(ThreadPoolBuilder::new().num_threads(threads).build()?));
        }
        let mut subjects: Vec<Subject> = Vec::new();
        for name in EngineName::CPU {
            for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                let engine = || cpu_engine(name, isa);
                // Masks do not depend on modes: those are asked with the widest instruction set alone.
                let is_best = isa == Isa::best();
                self.add(&mut subjects, name, isa.as_str(), is_best, &pools, engine)?;
            }
        }
        self.add_gpu(&mut subjects, &pools[..1])?;
        if self.requested.has("spheres", Form::Spheres) {
            pools.iter().try_for_each(|pool| self.add_spheres(&mut subjects, pool))?;
        }
        if subjects.is_empty() {
            let nobody = "nothing to run: spheres take part with --mode exact only, scenes with \
                          --clients only";
            return Err(nobody.into());
        }
        Ok(subjects)
    }

    /// Adds an engine of boxes: with every encoding and pool, and in every precision mode.
    fn add<E>(
        &self,
        subjects: &mut Vec<Subject>,
        name: EngineName,
        variant: &str,
        with_modes: bool,
        pools: &[Arc<ThreadPool>],
        engine: impl Fn() -> Result<Box<dyn Engine>, E>,
    ) -> Result<(), E> {
        for form in self.requested.forms_of_boxes(name.as_str()) {
            let (encodings, pools) = match form {
                Form::Boxes => (name.descriptor().encodings, pools),
                _ if with_modes => (&[Encoding::Sparse][..], &pools[pools.len() - 1..]),
                _ => continue,
            };
            for pool in pools {
                for &encoding in encodings {
                    let mut engine = engine()?;
                    if self.sabotage == Some(Sabotage::Lossy) {
                        engine = Box::new(Spoiler { engine, spoil: lose_a_pair });
                    }
                    let (pool, reply) = (Arc::clone(pool), HeapReply::new());
                    let is_broken = self.sabotage == Some(Sabotage::Inward);
                    let culler = Culler { engine, form, encoding, pool, reply, is_broken };
                    subjects.push(culler.subject(&format!("{name} {variant}")));
                }
            }
        }
        Ok(())
    }

    fn add_spheres(
        &self,
        subjects: &mut Vec<Subject>,
        pool: &Arc<ThreadPool>,
    ) -> Result<(), CullError> {
        let is_broken = self.sabotage == Some(Sabotage::Lossy);
        for encoding in Encoding::ALL {
            let mut add = |label: &str, mut cull: Box<CullsSpheres>| {
                let (name, pool) =
                    (name_of(label, Form::Spheres, encoding, pool), Arc::clone(pool));
                let (threads, mut reply) = (pool.current_num_threads(), HeapReply::new());
                let answer = move |case: &Case| {
                    let spheres = &case.spheres().spheres;
                    let cull = || cull(spheres, encoding, threads, &mut reply);
                    let mut report = case.flags.install(&pool, cull);
                    let mut words = reply.words().to_vec();
                    if is_broken && let Ok(report) = &mut report {
                        lose_a_pair(&mut words, report);
                    }
                    answer(report, &words, spheres.len())
                };
                let (engine, answer) = ("spheres", Box::new(answer));
                subjects.push(Subject { name, engine, form: Form::Spheres, answer });
            };
            for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                let mut all_pairs = SphereAllPairs::with_isa(isa)?;
                let way = move |spheres: &[Sphere], encoding, threads, reply: &mut HeapReply| {
                    let input = CullInput::spheres(spheres).encoding(encoding).threads(threads);
                    all_pairs.cull(&input, reply)
                };
                add(&format!("spheres all pairs {isa}"), Box::new(way));
            }
            // `cpu-brute` is all pairs, as above.
            let others = EngineName::CPU.into_iter().filter(|name| *name != EngineName::CpuBrute);
            for engine in others.map(EngineChoice::Only).chain([EngineChoice::Auto]) {
                let mut engines = SphereEngines::new();
                let way = move |spheres: &[Sphere], encoding, threads, reply: &mut HeapReply| {
                    let (encoding, threads) = (EncodingChoice::Only(encoding), Some(threads));
                    let options =
                        CullOptions { engine, encoding, threads, ..CullOptions::default() };
                    engines.cull(spheres, &options, reply).map(|answer| answer.report)
                };
                add(&format!("spheres through {engine}"), Box::new(way));
            }
        }
        Ok(())
    }

    fn add_gpu(&self, subjects: &mut Vec<Subject>, pools: &[Arc<ThreadPool>]) -> Result<()> {
        let engines = || EngineName::ALL.into_iter().filter(|name| name.is_gpu());
        let is_requested =
            |name: &EngineName| !self.requested.forms_of_boxes(name.as_str()).is_empty();
        if !engines().any(|name| is_requested(&name)) {
            return Ok(());
        }
        let is_named = self
            .requested
            .engines
            .iter()
            .any(|requested| engines().any(|name| name.as_str() == requested));
        let import = HostImport::IfPossible;
        let gpu = if is_named {
            Some(Gpu::open(&self.gpu, import)?)
        } else {
            open_if_any(&self.gpu, import)?
        };
        let Some(gpu) = gpu else { return Ok(()) };
        let device = &gpu.info().name;
        for name in engines() {
            for is_harder in [false, true] {
                let variant = match (is_harder, name) {
                    (false, _) => "",
                    (true, EngineName::GpuBrute) => ", many bands",
                    (true, _) => ", poisoned memory",
                };
                let variant = format!("on {device}{variant}");
                let engine = || -> Result<Box<dyn Engine>, GpuError> {
                    Ok(if name == EngineName::GpuBrute {
                        let matrix_bytes = is_harder.then_some(SMALL_MATRIX_BYTES);
                        let options = EngineOptions { matrix_bytes, ..Default::default() };
                        Box::new(AllPairs::new(&gpu, options)?)
                    } else {
                        let poison = is_harder.then_some(POISON);
                        let options = EngineOptions { poison, ..EngineOptions::default() };
                        Box::new(Grid::new(&gpu, &options)?)
                    })
                };
                self.add(subjects, name, &variant, !is_harder, pools, engine)?;
            }
        }
        Ok(())
    }
}

/// Spheres, in an encoding, by so many threads.
type CullsSpheres =
    dyn FnMut(&[Sphere], Encoding, usize, &mut HeapReply) -> Result<CullReport, CullError> + Send;

fn name_of(label: &str, form: Form, encoding: Encoding, pool: &ThreadPool) -> String {
    let threads = match pool.current_num_threads() {
        1 => "1 thread".to_owned(),
        threads => format!("{threads} threads"),
    };
    format!("{label}, {form}, {encoding}, {threads}")
}

/// What an engine said of so many objects, with the pairs in its mask.
fn answer(
    report: Result<CullReport, CullError>,
    words: &[u32],
    n: usize,
) -> Result<Reply, Finding> {
    let report = match report {
        Err(CullError::TooCrowded { .. }) => return Ok(Reply::Declined),
        report => report.map_err(|error| Finding::other(&error))?,
    };
    let pairs = decode(words, &report.shape, n as u32).map_err(|error| Finding::other(&error))?;
    Ok(Reply::Pairs(Answer { pairs, count: report.pair_count, census: report.census }))
}

/// An engine of boxes that is asked in a form, and answers in an encoding.
pub struct Culler {
    pub engine: Box<dyn Engine>,
    pub form: Form,
    pub encoding: Encoding,
    pub pool: Arc<ThreadPool>,
    pub reply: HeapReply,
    /// Whether modes round inward, to test that the checks notice.
    pub is_broken: bool,
}

impl Culler {
    /// `label` distinguishes it from others.
    pub fn subject(mut self, label: &str) -> Subject {
        let (form, engine) = (self.form, self.engine.name().as_str());
        let name = name_of(label, form, self.encoding, &self.pool);
        Subject { name, engine, form, answer: Box::new(move |case| self.answer(case)) }
    }

    fn cull(&mut self, case: &Case, boxes: &[Aabb]) -> Result<Reply, Finding> {
        let Self { engine, encoding, pool, reply, .. } = self;
        let threads = pool.current_num_threads();
        let input = CullInput::boxes(boxes).encoding(*encoding).threads(threads);
        let report = case.flags.install(pool, || engine.cull(&input, reply));
        answer(report, reply.words(), boxes.len())
    }

    /// Culls exact boxes twice, and checks all that an engine promises of its mask.
    fn check_boxes(&mut self, case: &Case) -> Result<Reply, Finding> {
        let Self { engine, encoding, pool, reply, .. } = self;
        let threads = pool.current_num_threads();
        let input = CullInput::boxes(&case.boxes).encoding(*encoding).threads(threads);
        let check = || check_frame(engine.as_mut(), &input, &case.truth, reply);
        match case.flags.install(pool, check) {
            Ok(()) => Ok(Reply::Right),
            Err(Mismatch::Cull(CullError::TooCrowded { .. })) => Ok(Reply::Declined),
            Err(mismatch @ (Mismatch::Missing(_) | Mismatch::Extra(_))) => {
                // All wrong pairs, by another run. Without any the answer changes from run to run.
                match self.cull(case, &case.boxes)? {
                    Reply::Pairs(answer) if case.check(Form::Boxes, &answer).is_err() => {
                        Ok(Reply::Pairs(answer))
                    }
                    _ => Err(Finding::other(&format!("one run in some: {mismatch}"))),
                }
            }
            Err(mismatch) => Err(Finding::other(&mismatch)),
        }
    }

    fn answer(&mut self, case: &Case) -> Result<Reply, Finding> {
        let Form::Mode(usage) = self.form else { return self.check_boxes(case) };
        let sent = case.in_mode(usage);
        if let Some(index) = sent.written_unlike {
            let what = format!("box {index} becomes another one when it is written by itself");
            return Err(Finding::other(&what));
        }
        // Broken, faces are rounded inward instead of outward.
        let inward = self.is_broken.then(|| {
            let is_inflated = matches!(sent.sending, Sending::Inflated(_));
            let boxes = if is_inflated { &sent.given } else { &sent.sent };
            boxes.iter().map(shrink).collect::<Vec<Aabb>>()
        });
        self.cull(case, inward.as_deref().unwrap_or(&sent.sent))
    }
}
