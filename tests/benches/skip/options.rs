//! Options of the bench.

use std::path::PathBuf;

use pairmask::Backend;
use pairmask_lab::study::moving::Motion;
use pairmaskd::scene::SceneName;

use super::peer::PeerName;

/// Shares of boxes that move, %.
const PERCENTS: [f64; 7] = [0.0, 0.01, 0.1, 1.0, 10.0, 50.0, 100.0];
/// The share that spawns and dies, %, unless shares are asked for.
const SPAWN_PERCENTS: [f64; 1] = [1.0];

pub struct Options {
    pub sizes: Vec<usize>,
    pub scenes: Vec<SceneName>,
    percents: Option<Vec<f64>>,
    pub motions: Vec<Motion>,
    pub frames: u32,
    pub backends: Vec<Backend>,
    pub peers: Vec<PeerName>,
    /// Frames a second; `None` is a closed loop.
    pub rates: Vec<Option<f64>>,
    pub svg: Option<PathBuf>,
    pub json: bool,
}

impl Options {
    pub fn parse(args: impl IntoIterator<Item = String>) -> Result<Self, String> {
        let mut options = Self {
            sizes: vec![10_000, 100_000],
            scenes: vec![SceneName::Uniform, SceneName::Pile],
            percents: None,
            motions: Motion::ALL.map(|(_, motion)| motion).to_vec(),
            frames: 20,
            backends: vec![Backend::InProcess],
            peers: vec![PeerName::Frame],
            rates: vec![None],
            svg: None,
            json: false,
        };
        let mut args = args.into_iter().filter(|a| a != "--bench");
        while let Some(flag) = args.next() {
            if flag == "--json" {
                options.json = true;
                continue;
            }
            let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
            let items = || value.split(',');
            let number =
                |s: &str| s.replace('_', "").parse::<u32>().map_err(|e| format!("{s}: {e}"));
            let share = |s: &str| match s.parse() {
                Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(percent),
                _ => Err(format!("'{s}' is no share of 0 to 100 %")),
            };
            match flag.as_str() {
                "--n" => {
                    let size = |s| number(s).map(|n| n as usize);
                    options.sizes = items().map(size).collect::<Result<_, _>>()?;
                }
                "--frames" => options.frames = number(&value)?.max(1),
                "--scene" => options.scenes = parsed(&value)?,
                "--moving" => {
                    options.percents = Some(items().map(share).collect::<Result<_, _>>()?);
                }
                "--backend" => options.backends = parsed(&value)?,
                "--peer" => options.peers = parsed(&value)?,
                "--motion" => options.motions = parsed(&value)?,
                "--rate" => options.rates = items().map(rate).collect::<Result<_, _>>()?,
                "--svg" => options.svg = Some(value.into()),
                _ => return Err(format!("unknown option {flag}")),
            }
        }
        Ok(options)
    }

    /// The shares of boxes that move in this way, %.
    pub fn percents(&self, motion: Motion) -> &[f64] {
        match &self.percents {
            Some(percents) => percents,
            None if motion == Motion::Spawn => &SPAWN_PERCENTS,
            None => &PERCENTS,
        }
    }
}

fn parsed<T: std::str::FromStr<Err: std::fmt::Display>>(value: &str) -> Result<Vec<T>, String> {
    value.split(',').map(|s| s.parse().map_err(|e: T::Err| e.to_string())).collect()
}

fn rate(text: &str) -> Result<Option<f64>, String> {
    match text.parse() {
        _ if text == "closed" => Ok(None),
        Ok(rate) if (0.01..=1e6).contains(&rate) => Ok(Some(rate)),
        _ => Err(format!("'{text}' is no rate: use closed, or frames a second")),
    }
}
