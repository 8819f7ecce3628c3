//! The ways that can serve a work: who finds the pairs, what is sent, with how many threads.

use std::fmt;

use pairmask_core::precision::Margin;
use pairmask_core::{EngineChoice, EngineName};

use super::workload::{Work, Workload};
use crate::precision::PrecisionChoice;
use crate::recording::Asked;

/// Cores from which on a few threads are measured too, between one and the plan's choice.
const MANY_CORES: usize = 8;
/// Of so many cores one thread is one of the few.
const FEW_SHARE: usize = 4;

/// Who finds the pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Host {
    InProcess,
    /// A daemon without a GPU.
    Daemon,
    /// A daemon with one.
    Gpu,
}

/// What is sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Frame(PrecisionChoice),
    Scene(Option<MarginOf>),
}

/// Margins of a scene's boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarginOf {
    pub margin: Margin,
    /// Whether pairs of inflated boxes are reported.
    pub near: bool,
}

/// A way to serve a work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    pub form: Form,
    pub host: Host,
    /// `None` leaves them to the plan.
    pub threads: Option<usize>,
    pub engine: EngineChoice,
}

impl Way {
    /// Whether it may report pairs that are near.
    pub const fn is_near(&self) -> bool {
        match self.form {
            Form::Frame(precision) => !matches!(precision, PrecisionChoice::Exact),
            Form::Scene(Some(MarginOf { near, .. })) => near,
            Form::Scene(None) => false,
        }
    }

    /// The simpler of two ways has the lower one: fewer settings, and no second process.
    pub fn complexity(&self) -> u32 {
        let form = match self.form {
            Form::Frame(PrecisionChoice::Exact) => 0,
            Form::Scene(None) => 1,
            Form::Frame(_) => 2,
            Form::Scene(Some(_)) => 3,
        };
        let is_named = self.engine != EngineChoice::Auto;
        10 * self.host as u32
            + 2 * form
            + u32::from(self.threads.is_some())
            + 2 * u32::from(is_named)
    }

    pub fn what(&self) -> String {
        match self.form {
            Form::Frame(PrecisionChoice::Exact) => "frame".to_owned(),
            Form::Frame(precision) => format!("frame, {precision}"),
            Form::Scene(None) => "scene".to_owned(),
            Form::Scene(Some(MarginOf { margin, near })) => {
                let near = if near { ", near" } else { "" };
                format!("scene, margin {}{near}", margin.get())
            }
        }
    }

    pub fn who(&self) -> String {
        let who = match self.host {
            Host::InProcess => "in process",
            Host::Daemon => "daemon",
            Host::Gpu => "GPU daemon",
        };
        match self.engine {
            EngineChoice::Auto => who.to_owned(),
            EngineChoice::Only(engine) => format!("daemon, {engine}"),
        }
    }

    pub fn threads_text(&self) -> String {
        self.threads.map_or_else(|| "plan".to_owned(), |threads| threads.to_string())
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.what(), self.who())?;
        match self.threads {
            None => Ok(()),
            Some(1) => write!(f, ", 1 thread"),
            Some(threads) => write!(f, ", {threads} threads"),
        }
    }
}

/// What there is to serve with.
#[derive(Clone, Copy, Debug)]
pub struct Means {
    pub cores: usize,
    pub has_gpu: bool,
}

/// All ways that serve a work.
pub fn ways(workload: &Workload, means: Means) -> Vec<Way> {
    let hosts = hosts(means, is_shared(workload));
    let forms = forms(workload);
    let with_host = |form: Form| {
        let way = |&(host, threads, engine): &(_, _, _)| Way { form, host, threads, engine };
        hosts.iter().map(way).collect::<Vec<_>>()
    };
    forms.into_iter().flat_map(with_host).collect()
}

/// Hosts with threads and engines.
pub(super) fn hosts(means: Means, is_shared: bool) -> Vec<(Host, Option<usize>, EngineChoice)> {
    let few = (means.cores >= MANY_CORES).then_some(means.cores / FEW_SHARE);
    let one = (means.cores > 1).then_some(1);
    let threads: Vec<Option<usize>> =
        std::iter::once(None).chain([one, few].into_iter().flatten().map(Some)).collect();
    let places = if is_shared { &[Host::Daemon][..] } else { &[Host::InProcess, Host::Daemon] };
    let of_cores = |host: &Host| {
        let host = *host;
        threads.iter().map(move |threads| (host, *threads, EngineChoice::Auto))
    };
    let mut all: Vec<_> = places.iter().flat_map(of_cores).collect();
    if means.has_gpu {
        all.push((Host::Gpu, None, EngineChoice::Auto));
        all.push((Host::Gpu, None, EngineChoice::Only(EngineName::GpuGrid)));
    }
    all
}

fn is_shared(workload: &Workload) -> bool {
    matches!(&workload.work, Work::Boxes(boxes) if !boxes.writers.is_empty())
}

fn forms(workload: &Workload) -> Vec<Form> {
    let exact = Form::Frame(PrecisionChoice::Exact);
    let narrow = Form::Frame(PrecisionChoice::Q16);
    match &workload.work {
        Work::Frames(frames) => {
            let has_spheres = frames.iter().any(|frame| matches!(frame.objects, Asked::Spheres(_)));
            if has_spheres { vec![exact] } else { vec![exact, narrow] }
        }
        Work::Edits(_) => vec![Form::Scene(None)],
        Work::Boxes(boxes) => {
            let margin = boxes.margin().and_then(|margin| Margin::new(margin).ok());
            let margins = margin.into_iter().flat_map(|margin| {
                // A shared scene reports near pairs in either case.
                let nears = if boxes.writers.is_empty() { &[false, true][..] } else { &[true] };
                nears.iter().map(move |near| Form::Scene(Some(MarginOf { margin, near: *near })))
            });
            let frames = if boxes.writers.is_empty() { vec![exact, narrow] } else { vec![] };
            frames.into_iter().chain([Form::Scene(None)]).chain(margins).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::Aabb;

    use super::*;
    use crate::advise::Answer;

    const CORES: Means = Means { cores: 2, has_gpu: false };

    #[test]
    fn what_serves_depends_on_the_work_and_the_machine() {
        let boxes: Vec<Aabb> =
            (0..50).map(|i| Aabb::new([i as f32; 3], [i as f32 + 1.5; 3])).collect();
        let work = Workload::of_boxes(boxes, 0.5, Answer::Pairs).expect("boxes");
        let all = ways(&work, CORES);
        let texts: Vec<String> = all.iter().map(Way::to_string).collect();
        for text in ["frame, in process", "frame, q16, daemon, 1 thread", "scene, daemon"] {
            assert!(texts.iter().any(|way| way == text), "{texts:?}");
        }
        assert!(texts.iter().any(|way| way.starts_with("scene, margin ")), "{texts:?}");
        assert!(all.iter().all(|way| way.host != Host::Gpu));
        let with_gpu = ways(&work, Means { has_gpu: true, ..CORES });
        assert!(with_gpu.iter().any(|way| way.to_string() == "frame, daemon, gpu-grid"));
        let many = ways(&work, Means { cores: 16, has_gpu: false });
        assert!(many.iter().any(|way| way.threads == Some(4)));
        assert!(
            ways(&work, Means { cores: 1, has_gpu: false }).iter().all(|way| way.threads.is_none())
        );
    }

    #[test]
    fn one_process_and_no_settings_are_simpler() {
        let plain = Way {
            form: Form::Frame(PrecisionChoice::Exact),
            host: Host::InProcess,
            threads: None,
            engine: EngineChoice::Auto,
        };
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        for other in [
            Way { threads: Some(1), ..plain },
            Way { host: Host::Daemon, ..plain },
            Way { form: Form::Scene(None), ..plain },
            Way { engine, host: Host::Gpu, ..plain },
        ] {
            assert!(plain.complexity() < other.complexity(), "{other}");
        }
    }
}
