//! Settings of scenes, by their names in Python.

use pairmask::{AtEnd, JoinOptions, Margin, MarginedPairs, SceneOptions, Scope};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::Raise;
use crate::frame::seconds;

/// What a scene may hold, and whether its boxes have margins.
pub fn scene_options(
    most_boxes: Option<u32>,
    threads: Option<usize>,
    margins: Option<&str>,
    usual_margin: f32,
) -> PyResult<SceneOptions> {
    let options = SceneOptions::default();
    let options = most_boxes.map_or(options, |most| options.with_most_boxes(most));
    let options = threads.map_or(options, |threads| options.with_threads(threads));
    let pairs = match margins {
        None => return Ok(options),
        Some("exact") => MarginedPairs::Exact,
        Some("near") => MarginedPairs::Near,
        Some(name) => {
            return Err(PyValueError::new_err(format!("no margins '{name}': exact, near")));
        }
    };
    Ok(options.with_margins(pairs, Margin::new(usual_margin).map_err(Raise::raise)?))
}

/// What a member asks of a shared scene.
pub fn join_options(
    most_boxes: Option<u32>,
    tick_deadline: Option<f64>,
    at_end: Option<&str>,
    scope: &str,
    usual_margin: Option<f32>,
) -> PyResult<JoinOptions> {
    let unknown = |name: &str, known: &str| {
        Err(PyValueError::new_err(format!("'{name}' is none of these: {known}")))
    };
    let mut options = JoinOptions::default().with_scope(match scope {
        "own" => Scope::Own,
        "all" => Scope::All,
        _ => return unknown(scope, "own, all"),
    });
    if let Some(most) = most_boxes {
        options = options.with_most_boxes(most);
    }
    if let Some(deadline) = tick_deadline {
        options = options.with_tick_deadline(seconds(deadline)?);
    }
    match at_end {
        None => {}
        Some("remove") => options = options.with_at_end(AtEnd::Remove),
        Some("keep") => options = options.with_at_end(AtEnd::Keep),
        Some(name) => return unknown(name, "remove, keep"),
    }
    if let Some(usual) = usual_margin {
        options = options.with_usual_margin(Margin::new(usual).map_err(Raise::raise)?);
    }
    Ok(options)
}
