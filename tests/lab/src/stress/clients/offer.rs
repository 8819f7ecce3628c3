//! What clients may ask for, and what one session asks for: engine, encoding, threads, backend.

use std::fmt;

use pairmask::{Backend, SessionBuilder};
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_core::{Encoding, EncodingChoice};
use pairmaskd::scene::Random;
use serde::{Deserialize, Serialize};

use crate::stress::modes::{Mode, ModeChoice, Usage};
use crate::stress::roster::Entrant;

/// Most frames of a session that are filled, under way or held: the library's own limit.
pub(super) const MOST_UNDER_WAY: usize = 3;

/// The objects of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Form {
    /// Boxes in f32.
    Boxes,
    /// Spheres.
    Spheres,
    /// Boxes in one usage of a precision mode.
    Mode(Usage),
}

impl Form {
    /// The precision mode.
    pub(super) const fn mode(self) -> Mode {
        match self {
            Self::Boxes | Self::Spheres => Mode::Exact,
            Self::Mode(usage) => usage.mode(),
        }
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Boxes => f.write_str("boxes"),
            Self::Spheres => f.write_str("spheres"),
            Self::Mode(usage) => usage.fmt(f),
        }
    }
}

/// What a session sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Asked {
    /// A frame.
    Frame(Form),
    /// An edit of a scene that persists.
    Edit,
}

impl Asked {
    /// The precision mode.
    pub(super) const fn mode(self) -> Mode {
        match self {
            Self::Frame(form) => form.mode(),
            Self::Edit => Mode::Exact,
        }
    }
}

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(form) => form.fmt(f),
            Self::Edit => f.write_str("scenes"),
        }
    }
}

/// Of sessions that may edit scenes, one request in so many is an edit.
const EDIT_ONE_IN: u64 = 4;

/// What the clients of a run may ask for.
#[derive(Clone, Debug)]
pub(super) struct Offer {
    /// Engines that frames of boxes may ask for.
    box_engines: Vec<EngineChoice>,
    box_forms: Vec<Form>,
    /// Engines that frames of spheres may ask for.
    sphere_engines: Vec<EngineChoice>,
    /// Engines that scenes may ask for.
    scene_engines: Vec<EngineChoice>,
    /// Most threads that a frame may ask for.
    most_threads: usize,
}

impl Offer {
    /// What `--engine`, `--mode` and `--threads` leave; engines of the GPU only `with_gpu`. The update
    /// stage asks no daemon, and takes no part.
    pub(super) fn new(
        entrants: &[Entrant],
        modes: &[ModeChoice],
        most_threads: usize,
        with_gpu: bool,
    ) -> Self {
        let has = |wanted: &[Entrant]| entrants.iter().any(|entrant| wanted.contains(entrant));
        let has_mode = |mode: Mode| modes.iter().any(|choice| choice.has(mode));
        let exact = has_mode(Mode::Exact).then_some(Form::Boxes);
        let usages = Usage::ALL.into_iter().filter(|usage| has_mode(usage.mode()));
        let auto = |wanted: &[Entrant]| has(wanted).then_some(EngineChoice::Auto);
        let named = EngineName::ALL.into_iter().filter(|name| {
            (with_gpu || !name.is_gpu()) && has(&[Entrant::All, Entrant::Engine(*name)])
        });
        let spheres: &[Entrant] =
            if has_mode(Mode::Exact) { &[Entrant::All, Entrant::Spheres] } else { &[] };
        let of_spheres = EngineName::CPU.into_iter().filter(|_| has(spheres));
        let scenes: &[Entrant] =
            if has_mode(Mode::Exact) { &[Entrant::All, Entrant::Scenes] } else { &[] };
        let keepers = [EngineName::CpuGrid, EngineName::GpuGrid].into_iter();
        let keepers = keepers.filter(|name| (with_gpu || !name.is_gpu()) && has(scenes));
        let scene_engines = auto(scenes).into_iter().chain(keepers.map(EngineChoice::Only));
        let box_engines = auto(&[Entrant::All]).into_iter().chain(named.map(EngineChoice::Only));
        let sphere_engines = auto(spheres).into_iter().chain(of_spheres.map(EngineChoice::Only));
        Self {
            box_engines: box_engines.collect(),
            box_forms: exact.into_iter().chain(usages.map(Form::Mode)).collect(),
            sphere_engines: sphere_engines.collect(),
            scene_engines: scene_engines.collect(),
            most_threads: most_threads.max(1),
        }
    }

    /// Whether there is nothing to ask for.
    pub(super) fn is_empty(&self) -> bool {
        self.engines().all(|engine| self.asked_of(engine).is_empty())
    }

    /// Engines and forms by name, for the report.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for engine in self.engines() {
            for asked in self.asked_of(engine) {
                let name = format!("{asked} by {engine}");
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        names
    }

    fn engines(&self) -> impl Iterator<Item = EngineChoice> {
        self.box_engines.iter().chain(&self.sphere_engines).chain(&self.scene_engines).copied()
    }

    /// What an engine may be asked for.
    fn asked_of(&self, engine: EngineChoice) -> Vec<Asked> {
        let mut asked = Vec::new();
        if self.box_engines.contains(&engine) {
            asked.extend(self.box_forms.iter().copied().map(Asked::Frame));
        }
        if self.sphere_engines.contains(&engine) {
            asked.push(Asked::Frame(Form::Spheres));
        }
        if self.scene_engines.contains(&engine) {
            asked.push(Asked::Edit);
        }
        asked
    }

    /// What a session asks for. The offer is not empty.
    pub(super) fn draw(&self, random: &mut Random) -> Way {
        let engines: Vec<EngineChoice> =
            self.engines().filter(|engine| !self.asked_of(*engine).is_empty()).collect();
        let engine = *pick(&engines, random);
        let encodings = match engine {
            EngineChoice::Only(name) => name.descriptor().encodings,
            EngineChoice::Auto => &Encoding::ALL,
        };
        let encoding = match random.below(3) {
            0 => EncodingChoice::Auto,
            _ => EncodingChoice::Only(*pick(encodings, random)),
        };
        let threads = match random.below(3) {
            0 => Some(1 + random.below(self.most_threads as u64) as usize),
            _ => None,
        };
        let backend = if random.below(2) == 0 { Backend::Auto } else { Backend::Daemon };
        let depth = 1 + random.below(MOST_UNDER_WAY as u64) as usize;
        Way { engine, encoding, threads, backend, depth, asked: self.asked_of(engine) }
    }
}

/// What one session asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Way {
    engine: EngineChoice,
    encoding: EncodingChoice,
    threads: Option<usize>,
    backend: Backend,
    /// Most frames that it has under way.
    pub(super) depth: usize,
    asked: Vec<Asked>,
}

impl Way {
    /// The session's settings.
    pub(super) fn apply(&self, builder: SessionBuilder) -> SessionBuilder {
        let builder = builder.engine(self.engine).encoding(self.encoding).backend(self.backend);
        match self.threads {
            Some(threads) => builder.threads(threads),
            None => builder,
        }
    }

    /// What the session sends next: often an edit or plain boxes, where those are allowed.
    pub(super) fn next(&self, random: &mut Random) -> Asked {
        let boxes = Asked::Frame(Form::Boxes);
        if self.asked.contains(&Asked::Edit) && random.below(EDIT_ONE_IN) == 0 {
            Asked::Edit
        } else if self.asked.contains(&boxes) && random.below(2) == 0 {
            boxes
        } else {
            *pick(&self.asked, random)
        }
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { engine, encoding, threads, backend, .. } = self;
        write!(f, "engine {engine}, encoding {encoding}, ")?;
        match threads {
            Some(threads) => write!(f, "threads {threads}, ")?,
            None => f.write_str("threads of the plan, ")?,
        }
        write!(f, "backend {backend}")
    }
}

/// One of some; there is at least one.
pub(super) fn pick<'a, T>(these: &'a [T], random: &mut Random) -> &'a T {
    &these[random.below(these.len() as u64) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(entrant: Entrant, mode: ModeChoice, with_gpu: bool) -> Offer {
        Offer::new(&[entrant], &[mode], 2, with_gpu)
    }

    #[test]
    fn all_offers_every_engine_and_form() {
        let names = offer(Entrant::All, ModeChoice::All, true).names();
        for name in [
            "boxes by auto",
            "q8 by cpu-grid",
            "spheres by auto",
            "boxes by gpu-grid",
            "scenes by gpu-grid",
        ] {
            assert!(names.iter().any(|found| found == name), "{names:?} lacks {name}");
        }
        assert!(!names.iter().any(|name| name.starts_with("spheres by gpu")), "{names:?}");
        let names = offer(Entrant::All, ModeChoice::All, false).names();
        assert!(!names.iter().any(|name| name.contains("gpu")), "{names:?}");
    }

    #[test]
    fn what_no_client_can_ask_for_is_empty() {
        let q8 = ModeChoice::Only(Mode::Q8);
        for (entrant, mode, with_gpu) in [
            (Entrant::Updates, ModeChoice::All, true),
            (Entrant::Spheres, q8, true),
            (Entrant::Scenes, q8, true),
            (Entrant::Engine(EngineName::GpuGrid), ModeChoice::All, false),
        ] {
            assert!(offer(entrant, mode, with_gpu).is_empty(), "{entrant} {mode}");
        }
        let grid = offer(Entrant::Engine(EngineName::CpuGrid), q8, false);
        assert_eq!(grid.names(), ["q8 by cpu-grid", "q8 in small bounds by cpu-grid"]);
        let scenes = offer(Entrant::Scenes, ModeChoice::All, false);
        assert_eq!(scenes.names(), ["scenes by auto", "scenes by cpu-grid"]);
    }

    #[test]
    fn sessions_ask_for_everything_that_is_offered_and_for_nothing_else() {
        let offer = offer(Entrant::All, ModeChoice::All, true);
        let names = offer.names();
        let mut random = Random::new(1);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..3_000 {
            let way = offer.draw(&mut random);
            let asked = way.next(&mut random);
            let name = format!("{asked} by {}", way.engine);
            assert!(names.contains(&name), "{name}");
            if let (EngineChoice::Only(engine), EncodingChoice::Only(encoding)) =
                (way.engine, way.encoding)
            {
                assert!(engine.descriptor().encodings.contains(&encoding), "{way}");
            }
            assert!((1..=MOST_UNDER_WAY).contains(&way.depth));
            seen.insert(name);
        }
        assert_eq!(seen.len(), names.len());
    }
}
