//! What clients may ask for, and what one session asks for: engine, encoding, threads, backend.

use std::fmt;

use pairmask::{Backend, SessionBuilder};
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_core::{Encoding, EncodingChoice};
use pairmaskd::scene::Random;

use crate::stress::{Form, Requested};

/// Most frames of a session that are filled, under way or held: the library's own limit.
pub(super) const MOST_UNDER_WAY: usize = 3;
/// Of sessions that may edit scenes, one request in so many is an edit.
const EDIT_ONE_IN: u64 = 4;

/// What the clients of a run may ask for: engines, each with the forms that it may be asked in.
#[derive(Clone, Debug)]
pub(super) struct Offer {
    forms: Vec<(EngineChoice, Vec<Form>)>,
    most_threads: usize,
}

impl Offer {
    /// What `--engine`, `--mode` and `--threads` leave.
    pub(super) fn new(requested: &Requested, with_gpu: bool) -> Self {
        let named = EngineName::ALL.into_iter().filter(|name| with_gpu || !name.is_gpu());
        let choices = [EngineChoice::Auto].into_iter().chain(named.map(EngineChoice::Only));
        let forms = choices.map(|choice| {
            let (name, has_spheres, keeps_scenes) = match choice {
                // Boxes by any engine are nobody's where some are named.
                EngineChoice::Auto => ("auto", true, true),
                EngineChoice::Only(name) => {
                    let keeps = [EngineName::CpuGrid, EngineName::GpuGrid].contains(&name);
                    (name.as_str(), !name.is_gpu(), keeps)
                }
            };
            let mut forms = requested.forms_of_boxes(name);
            forms.extend(
                (has_spheres && requested.has("spheres", Form::Spheres)).then_some(Form::Spheres),
            );
            forms.extend(
                (keeps_scenes && requested.has("scenes", Form::Scene)).then_some(Form::Scene),
            );
            (choice, forms)
        });
        let forms = forms.filter(|(_, forms)| !forms.is_empty()).collect();
        Self { forms, most_threads: requested.threads.max(1) }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.forms.is_empty()
    }

    pub(super) fn names(&self) -> Vec<String> {
        let names = |(engine, forms): &(EngineChoice, Vec<Form>)| -> Vec<String> {
            forms.iter().map(|form| format!("{form} by {engine}")).collect()
        };
        self.forms.iter().flat_map(names).collect()
    }

    pub(super) fn draw(&self, random: &mut Random) -> Way {
        let (engine, forms) = pick(&self.forms, random).clone();
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
        Way { engine, encoding, threads, backend, depth, forms }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Way {
    engine: EngineChoice,
    encoding: EncodingChoice,
    threads: Option<usize>,
    backend: Backend,
    pub(super) depth: usize,
    forms: Vec<Form>,
}

impl Way {
    pub(super) fn apply(&self, builder: SessionBuilder) -> SessionBuilder {
        let builder = builder.engine(self.engine).encoding(self.encoding).backend(self.backend);
        match self.threads {
            Some(threads) => builder.threads(threads),
            None => builder,
        }
    }

    /// The form that is asked next: often an edit or plain boxes, where those are allowed.
    pub(super) fn next(&self, random: &mut Random) -> Form {
        if self.forms.contains(&Form::Scene) && random.below(EDIT_ONE_IN) == 0 {
            Form::Scene
        } else if self.forms.contains(&Form::Boxes) && random.below(2) == 0 {
            Form::Boxes
        } else {
            *pick(&self.forms, random)
        }
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { engine, encoding, threads, backend, .. } = self;
        let threads = threads.map_or("of the plan".to_owned(), |threads| threads.to_string());
        write!(f, "engine {engine}, encoding {encoding}, threads {threads}, backend {backend}")
    }
}

/// One of some; there is at least one.
pub(super) fn pick<'a, T>(these: &'a [T], random: &mut Random) -> &'a T {
    &these[random.below(these.len() as u64) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(engine: &str, mode: &str, with_gpu: bool) -> Offer {
        let (engines, modes) = (vec![engine.to_owned()], vec![mode.to_owned()]);
        Offer::new(&Requested { engines, modes, threads: 2 }, with_gpu)
    }

    #[test]
    fn sessions_ask_for_everything_that_is_offered_and_for_nothing_else() {
        for (engine, mode, with_gpu, names) in [
            ("spheres", "q8", true, &[][..]),
            ("scenes", "q8", true, &[]),
            ("gpu-grid", "all", false, &[]),
            ("cpu-grid", "q8", false, &["q8 by cpu-grid", "q8 in small bounds by cpu-grid"]),
            ("scenes", "all", false, &["scenes by auto", "scenes by cpu-grid"]),
        ] {
            assert_eq!(offer(engine, mode, with_gpu).names(), names, "{engine} {mode}");
        }
        let offer = offer("all", "all", true);
        let mut random = Random::new(1);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..3_000 {
            let way = offer.draw(&mut random);
            if let (EngineChoice::Only(engine), EncodingChoice::Only(encoding)) =
                (way.engine, way.encoding)
            {
                assert!(engine.descriptor().encodings.contains(&encoding), "{way}");
            }
            assert!((1..=MOST_UNDER_WAY).contains(&way.depth));
            seen.insert(format!("{} by {}", way.next(&mut random), way.engine));
        }
        let names = offer.names();
        assert_eq!(seen, names.iter().cloned().collect());
        assert!(!names.iter().any(|name| name.starts_with("spheres by gpu")), "{names:?}");
    }
}
