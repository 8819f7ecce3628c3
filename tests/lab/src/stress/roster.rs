//! The subjects that take part.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use pairmask_core::Encoding;
use pairmask_core::engine::{Engine, EngineName, Isa, UnknownName, cpu_engine};
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Gpu, GpuChoice, Grid, GridOptions, HostImport, OpenError, SceneTools,
};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::StressError;
use super::mode_subject::ModeSubject;
use super::modes::{Mode, ModeChoice, Usage};
use super::scene_subject::SceneSubject;
use super::spheres::SphereSubject;
use super::subject::{ExactSubject, Subject};
use super::updates::UpdateSubject;
use crate::sabotage::{Sabotage, Spoiler, lose_a_pair};

/// A value of `--engine`: one kind of subject, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entrant {
    /// All subjects that this machine can run.
    All,
    /// One engine, with every instruction set and encoding.
    Engine(EngineName),
    /// The sphere engines, in every way.
    Spheres,
    /// The update stage.
    Updates,
    /// Scenes that persist.
    Scenes,
}

impl FromStr for Entrant {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        match s {
            "all" => Ok(Self::All),
            "spheres" => Ok(Self::Spheres),
            "updates" => Ok(Self::Updates),
            "scenes" => Ok(Self::Scenes),
            _ => EngineName::from_name(s).map(Self::Engine).ok_or_else(|| UnknownName {
                name: s.to_owned(),
                known: format!("all, {}, spheres, updates, scenes", EngineName::listed(", "))
                    .into(),
            }),
        }
    }
}

impl fmt::Display for Entrant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Engine(name) => name.fmt(f),
            Self::Spheres => f.write_str("spheres"),
            Self::Updates => f.write_str("updates"),
            Self::Scenes => f.write_str("scenes"),
        }
    }
}

/// The subjects of a run, and their settings.
#[derive(Clone, Debug)]
pub struct Roster {
    /// The kinds of subjects.
    pub entrants: Vec<Entrant>,
    /// The precision modes.
    pub modes: Vec<ModeChoice>,
    /// Most threads of an engine; each takes part with one thread as well.
    pub threads: usize,
    /// The GPU. [`Entrant::All`] leaves GPU engines out on a machine without a GPU.
    pub gpu: GpuChoice,
    /// Break every engine or mode, to test that the checks notice.
    pub sabotage: Option<Sabotage>,
}

/// Bytes of a band's matrix, so small that scenes of more than about 2,000 boxes have several bands:
/// 512 rows, the fewest that a band may have, of up to 8,192 boxes, more than any case has.
const SMALL_MATRIX_BYTES: u64 = 512 * (8_192 / 32) * 4;

/// Pattern that fills the second grid's new video memory: a word that no stage wrote must not reach
/// an answer.
const POISON: u32 = 0xa5a5_a5a5;

impl Roster {
    /// The subjects, ready to run.
    ///
    /// # Errors
    /// [`StressError`] where a named one cannot be made.
    pub fn subjects(&self) -> Result<Vec<Box<dyn Subject>>, StressError> {
        let mut subjects = Vec::new();
        for name in EngineName::CPU {
            if self.has(name) {
                self.add_cpu(name, &mut subjects)?;
            }
        }
        let engines = EngineName::ALL.into_iter().any(|name| name.is_gpu() && self.has(name));
        if engines || self.has_scenes() {
            self.add_gpu(&mut subjects)?;
        }
        if self.has_scenes() {
            for pool in self.pools()? {
                subjects.push(Box::new(SceneSubject::new(&pool, self.is_lossy())));
            }
        }
        let spheres = self.entrants.iter().any(|e| [Entrant::All, Entrant::Spheres].contains(e));
        if spheres && self.has_mode(Mode::Exact) {
            subjects.extend(SphereSubject::all(&self.pools()?, self.is_lossy())?);
        }
        let updates = self.entrants.iter().any(|e| [Entrant::All, Entrant::Updates].contains(e));
        if updates && self.has_mode(Mode::Exact) {
            for pool in self.pools()? {
                subjects.push(Box::new(UpdateSubject::new(&pool, self.is_lossy())));
            }
        }
        if subjects.is_empty() {
            return Err(StressError::NoSubject);
        }
        Ok(subjects)
    }

    fn has_mode(&self, mode: Mode) -> bool {
        self.modes.iter().any(|choice| choice.has(mode))
    }

    fn has_scenes(&self) -> bool {
        let scenes = self.entrants.iter().any(|e| [Entrant::All, Entrant::Scenes].contains(e));
        scenes && self.has_mode(Mode::Exact)
    }

    fn is_lossy(&self) -> bool {
        self.sabotage == Some(Sabotage::Lossy)
    }

    fn has(&self, name: EngineName) -> bool {
        self.entrants.iter().any(|e| [Entrant::All, Entrant::Engine(name)].contains(e))
    }

    fn add_cpu(
        &self,
        name: EngineName,
        subjects: &mut Vec<Box<dyn Subject>>,
    ) -> Result<(), StressError> {
        let pools = self.pools()?;
        if let Some(pool) = pools.last() {
            let best = Isa::best();
            self.add_modes(&format!(" {best}"), pool, subjects, || Ok(cpu_engine(name, best)?))?;
        }
        if !self.has_mode(Mode::Exact) {
            return Ok(());
        }
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for pool in &pools {
                for encoding in Encoding::ALL {
                    let engine = cpu_engine(name, isa)?;
                    self.add(engine, isa.as_str(), encoding, pool, subjects);
                }
            }
        }
        Ok(())
    }

    /// A pool of one thread, and one of all.
    fn pools(&self) -> Result<Vec<Arc<ThreadPool>>, StressError> {
        let mut pools = vec![pool(1)?];
        if self.threads > 1 {
            pools.push(pool(self.threads)?);
        }
        Ok(pools)
    }

    fn add_gpu(&self, subjects: &mut Vec<Box<dyn Subject>>) -> Result<(), StressError> {
        let named =
            self.entrants.iter().any(|e| matches!(e, Entrant::Engine(name) if name.is_gpu()));
        if self.gpu == GpuChoice::None {
            // Adapters are not even listed: that takes time and loads every driver.
            return if named { Err(OpenError::SwitchedOff.into()) } else { Ok(()) };
        }
        let gpu = match Gpu::open(&self.gpu, HostImport::IfPossible) {
            Ok(gpu) => gpu,
            Err(OpenError::NoAdapter { .. }) if !named && self.gpu == GpuChoice::Auto => {
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        let pool = pool(1)?;
        if self.has_scenes() {
            let tools = SceneTools::new(&gpu, &GridOptions::default())?;
            subjects.push(Box::new(SceneSubject::on_gpu(tools, &pool, self.is_lossy())));
        }
        if self.has(EngineName::GpuBrute) {
            self.add_all_pairs(&gpu, &pool, subjects)?;
        }
        if self.has(EngineName::GpuGrid) {
            self.add_gpu_grid(&gpu, &pool, subjects)?;
        }
        Ok(())
    }

    fn add_all_pairs(
        &self,
        gpu: &Arc<Gpu>,
        pool: &Arc<ThreadPool>,
        subjects: &mut Vec<Box<dyn Subject>>,
    ) -> Result<(), StressError> {
        let on = format!(" on {}", gpu.info().name);
        self.add_modes(&on, pool, subjects, || {
            Ok(Box::new(AllPairs::new(gpu, AllPairsOptions::default())?))
        })?;
        if !self.has_mode(Mode::Exact) {
            return Ok(());
        }
        for (variant, matrix_bytes) in [("", None), (", many bands", Some(SMALL_MATRIX_BYTES))] {
            for encoding in Encoding::ALL {
                let options = AllPairsOptions { matrix_bytes, ..AllPairsOptions::default() };
                let engine = AllPairs::new(gpu, options)?;
                let variant = format!("on {}{variant}", gpu.info().name);
                self.add(Box::new(engine), &variant, encoding, pool, subjects);
            }
        }
        Ok(())
    }

    fn add_gpu_grid(
        &self,
        gpu: &Arc<Gpu>,
        pool: &Arc<ThreadPool>,
        subjects: &mut Vec<Box<dyn Subject>>,
    ) -> Result<(), StressError> {
        let on = format!(" on {}", gpu.info().name);
        self.add_modes(&on, pool, subjects, || {
            Ok(Box::new(Grid::new(gpu, &GridOptions::default())?))
        })?;
        if !self.has_mode(Mode::Exact) {
            return Ok(());
        }
        for (variant, poison) in [("", None), (", poisoned memory", Some(POISON))] {
            for encoding in EngineName::GpuGrid.descriptor().encodings {
                let engine = Grid::new(gpu, &GridOptions { poison, ..GridOptions::default() })?;
                let variant = format!("on {}{variant}", gpu.info().name);
                self.add(Box::new(engine), &variant, *encoding, pool, subjects);
            }
        }
        Ok(())
    }

    fn add(
        &self,
        engine: Box<dyn Engine>,
        variant: &str,
        encoding: Encoding,
        pool: &Arc<ThreadPool>,
        subjects: &mut Vec<Box<dyn Subject>>,
    ) {
        let engine = self.maybe_lossy(engine);
        subjects.push(Box::new(ExactSubject::new(engine, variant, encoding, pool)));
    }

    /// Adds a subject with its own engine for every usage of a mode other than exact.
    fn add_modes(
        &self,
        variant: &str,
        pool: &Arc<ThreadPool>,
        subjects: &mut Vec<Box<dyn Subject>>,
        engine: impl Fn() -> Result<Box<dyn Engine>, StressError>,
    ) -> Result<(), StressError> {
        let inward = self.sabotage == Some(Sabotage::Inward);
        for usage in Usage::ALL.into_iter().filter(|usage| self.has_mode(usage.mode())) {
            let engine = self.maybe_lossy(engine()?);
            subjects.push(Box::new(ModeSubject::new(engine, variant, usage, pool, inward)));
        }
        Ok(())
    }

    fn maybe_lossy(&self, engine: Box<dyn Engine>) -> Box<dyn Engine> {
        if self.is_lossy() { Box::new(Spoiler { engine, spoil: lose_a_pair }) } else { engine }
    }
}

fn pool(threads: usize) -> Result<Arc<ThreadPool>, StressError> {
    Ok(Arc::new(ThreadPoolBuilder::new().num_threads(threads).build()?))
}
