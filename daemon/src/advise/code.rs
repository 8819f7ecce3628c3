//! The lines of Rust that take an advice. Those of each kind are kept in `printed.rs`, where tests compile them.

use pairmask_core::EngineChoice;

use super::options::{Form, Host, MarginOf, Way};
use super::workload::{Answer, Work, Workload};
use crate::precision::PrecisionChoice;
use crate::recording::Asked;

/// The lines that make the session and do a tick.
pub fn lines(way: &Way, workload: &Workload) -> Vec<String> {
    let mut code = session(way);
    match (way.form, &workload.work) {
        (Form::Frame(precision), work) => code.extend(frame(precision, work)),
        (Form::Scene(margin), work) => code.extend(scene(margin, work)),
    }
    code
}

fn session(way: &Way) -> Vec<String> {
    let backend = match way.host {
        Host::InProcess => "    .backend(Backend::InProcess)".to_owned(),
        // What ships takes the daemon where one serves.
        Host::Daemon | Host::Gpu => {
            "    .backend(Backend::Auto) // the daemon where one serves, else here".to_owned()
        }
    };
    let engine = match way.engine {
        EngineChoice::Auto => None,
        EngineChoice::Only(engine) => Some(format!("    .engine(\"{engine}\".parse()?)")),
    };
    let threads = way.threads.map(|threads| format!("    .threads({threads})"));
    let first = ["let mut session = Session::builder()".to_owned(), backend];
    let more = engine.into_iter().chain(threads).chain(["    .connect()?;".to_owned()]);
    first.into_iter().chain(more).collect()
}

fn frame(precision: PrecisionChoice, work: &Work) -> Vec<String> {
    let frames = match work {
        Work::Frames(frames) => &frames[..],
        _ => &[],
    };
    let has_spheres = frames.iter().any(|frame| matches!(frame.objects, Asked::Spheres(_)));
    let split = frames.iter().find_map(|frame| frame.split_at);
    let has_filters = frames.iter().any(|frame| frame.filters.is_some());
    let is_narrow = precision != PrecisionChoice::Exact;
    let mut code = Vec::new();
    if is_narrow {
        code.push("let world = Bounds::around(boxes); // or those of your world".to_owned());
        let mode = precision.mode().to_uppercase();
        code.push(format!(
            "let mut frame = session.narrow_frame(boxes.len(), Precision::{mode}(world))?;"
        ));
    } else if has_spheres {
        code.push("let mut frame = session.sphere_frame(spheres.len())?;".to_owned());
    } else {
        code.push("let mut frame = session.frame(boxes.len())?;".to_owned());
    }
    code.push(if has_spheres {
        "frame.spheres_mut().copy_from_slice(spheres);".to_owned()
    } else {
        "frame.write(boxes)?;".to_owned()
    });
    if has_filters {
        code.push("let filters = Some(Arc::clone(rules)); // the same while they stay".to_owned());
    }
    // No frame has both.
    let options = match (split, has_filters) {
        (Some(first), _) => Some(format!("split_at: Some({first})")),
        (None, true) => Some("filters".to_owned()),
        (None, false) => None,
    };
    if let Some(options) = options {
        code.push(format!("let options = FrameOptions {{ {options}, ..Default::default() }};"));
        code.push("let mask = frame.submit_with(&options)?.wait()?;".to_owned());
    } else {
        code.push("let mask = frame.submit()?.wait()?;".to_owned());
    }
    code.extend(["for [a, b] in mask.pairs() {", "    meet(a, b);", "}"].map(str::to_owned));
    code
}

fn scene(margin: Option<MarginOf>, work: &Work) -> Vec<String> {
    let (answer, writer) = match work {
        Work::Boxes(boxes) => (boxes.answer, boxes.writers.first()),
        _ => (Answer::Changes, None),
    };
    let mut code = vec!["let options = SceneOptions::default()".to_owned()];
    if let Some(MarginOf { margin, near }) = margin {
        code.push(format!("    .with_margin(Margin::new({:?})?)", margin.get()));
        if near && writer.is_none() {
            code.push("    .with_near_pairs(true)".to_owned());
        }
    }
    if writer.is_some() {
        code.push("    .with_shared(\"world\")".to_owned());
    }
    if let Some(last) = code.last_mut() {
        last.push(';');
    }
    code.push("let mut scene = session.scene(options)?; // once".to_owned());
    if let Some(range) = writer {
        code.push(format!("scene.lease({range:?})?; // each writer its own indices"));
    }
    code.push("let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);".to_owned());
    code.extend(match answer {
        Answer::Pairs => pairs(),
        Answer::Changes => changes(),
    });
    code
}

fn pairs() -> Vec<String> {
    let code = [
        "let answer = edit.commit(Report::All)?;",
        "for [a, b] in answer.pairs() {",
        "    meet(a, b);",
        "}",
    ];
    code.map(str::to_owned).into()
}

fn changes() -> Vec<String> {
    let code = [
        "let answer = edit.commit(Report::Changes)?;",
        "if answer.is_resync() {",
        "    known.clear(); // all pairs come anew",
        "}",
        "// These first: an index may have another box now.",
        "for ended in answer.ended() {",
        "    known.remove(&ended.pair);",
        "}",
        "known.extend(answer.begun());",
        "known.extend(answer.pairs());",
    ];
    code.map(str::to_owned).into()
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::sync::Arc;

    use pairmask_core::precision::Margin;
    use pairmask_core::{Aabb, BoxForm, EngineName, ObjectForm, Sphere};

    use super::super::workload::Boxes;
    use super::*;
    use crate::recording::AskedFrame;

    const PLAIN: Way = Way {
        form: Form::Frame(PrecisionChoice::Exact),
        host: Host::InProcess,
        threads: None,
        engine: EngineChoice::Auto,
    };

    fn workload(work: Work) -> Workload {
        Workload { work, accepts_near: false, notes: vec![] }
    }

    fn boxes(answer: Answer, shared: bool) -> Workload {
        let writers = if shared { vec![0..1_000, 1_000..2_000] } else { vec![] };
        workload(Work::Boxes(Boxes::new(vec![vec![Aabb::EMPTY; 2]; 2], answer, writers)))
    }

    fn asked(objects: Asked, split_at: Option<usize>, has_filters: bool) -> Workload {
        let form = ObjectForm::Boxes(BoxForm::F32);
        let filters = has_filters.then(Arc::default);
        workload(Work::Frames(vec![AskedFrame { objects, form, filters, split_at }]))
    }

    /// A name for each kind of advice, the advice, and the work.
    fn kinds() -> Vec<(&'static str, Way, Workload)> {
        let margin = |near| {
            let margin = Margin::new(0.5).expect("a margin");
            Way { form: Form::Scene(Some(MarginOf { margin, near })), ..PLAIN }
        };
        let scene = Way { form: Form::Scene(None), ..PLAIN };
        let narrow = Way { form: Form::Frame(PrecisionChoice::Q16), host: Host::Daemon, ..PLAIN };
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        let gpu = Way { host: Host::Gpu, engine, ..PLAIN };
        let some = || Asked::Boxes(vec![Aabb::EMPTY; 3]);
        let spheres = Asked::Spheres(vec![Sphere::new([0.0; 3], 1.0)]);
        let (pairs, changes) = (Answer::Pairs, Answer::Changes);
        vec![
            ("frame", PLAIN, boxes(pairs, false)),
            ("frame_of_gpu", gpu, boxes(pairs, false)),
            ("narrow", Way { threads: Some(1), ..narrow }, boxes(pairs, false)),
            ("spheres", PLAIN, asked(spheres, None, false)),
            ("two_sets", PLAIN, asked(some(), Some(1), false)),
            ("filters", PLAIN, asked(some(), None, true)),
            ("narrow_filters", narrow, asked(some(), None, true)),
            ("scene_pairs", scene, boxes(pairs, false)),
            ("scene_changes", Way { threads: Some(2), ..scene }, boxes(changes, false)),
            ("margin", margin(false), boxes(changes, false)),
            ("margin_near", margin(true), boxes(pairs, false)),
            ("shared", Way { host: Host::Daemon, ..margin(true) }, boxes(changes, true)),
        ]
    }

    const HEAD: &str = "\
//! What `advise` prints of each kind, compiled. A test of `code` holds it to what is printed, and writes it where
//! `PAIRMASK_WRITE_PRINTED` is set.
#![allow(dead_code, unused_variables)]

use std::collections::HashSet;
use std::error::Error;
use std::sync::Arc;

use pairmask::filters::Rules;
use pairmask::{
    Aabb, Backend, Bounds, FrameOptions, Margin, Precision, Report, SceneOptions, Session, Sphere,
};

struct Program<'a> {
    boxes: &'a [Aabb],
    moved: &'a [u32],
    spheres: &'a [Sphere],
    rules: &'a Arc<Rules>,
    known: &'a mut HashSet<[u32; 2]>,
    meet: fn(u32, u32),
}
";

    #[test]
    fn what_is_printed_of_each_kind_is_compiled() {
        let mut printed = HEAD.to_owned();
        for (name, way, workload) in kinds() {
            let code = lines(&way, &workload).join("\n    ");
            let _ = write!(
                printed,
                "\nfn {name}(program: Program<'_>) -> Result<(), Box<dyn Error>> {{\n    \
                 let Program {{ boxes, moved, spheres, rules, known, meet }} = program;\n    \
                 {code}\n    Ok(())\n}}\n"
            );
        }
        let widest = printed.lines().map(str::len).filter(|len| *len > 80).count();
        let of_head = HEAD.lines().filter(|line| line.len() > 80).count();
        assert_eq!(widest, of_head, "lines fit a terminal");
        if std::env::var_os("PAIRMASK_WRITE_PRINTED").is_some() {
            std::fs::write("src/advise/printed.rs", &printed).expect("the source");
        }
        assert!(include_str!("printed.rs") == printed, "set PAIRMASK_WRITE_PRINTED and test again");
    }
}
