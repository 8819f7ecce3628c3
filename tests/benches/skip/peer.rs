//! What a scene is set beside: whole frames, or another library's broad phase in the same state.

use std::error::Error;
use std::hint::black_box;
use std::str::FromStr;

use pairmask::{Aabb, Session};
#[cfg(feature = "peers")]
use pairmask_tests::peers::parry_scene::{ParryScene, ParryWay};
#[cfg(feature = "peers")]
use pairmask_tests::peers::rapier::Rapier;

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum PeerName {
    Frame,
    #[cfg(feature = "peers")]
    Rapier,
    #[cfg(feature = "peers")]
    Parry,
    #[cfg(feature = "peers")]
    ParryQueries,
}

impl PeerName {
    const ALL: &[(&str, Self)] = &[
        ("whole-frame", Self::Frame),
        #[cfg(feature = "peers")]
        ("rapier", Self::Rapier),
        #[cfg(feature = "peers")]
        ("parry", Self::Parry),
        #[cfg(feature = "peers")]
        ("parry-queries", Self::ParryQueries),
    ];

    pub fn as_str(self) -> &'static str {
        Self::ALL.iter().find(|(_, peer)| *peer == self).map_or("", |(name, _)| name)
    }
}

impl FromStr for PeerName {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        // Its name in earlier versions.
        let name = if name == "frame" { "whole-frame" } else { name };
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found.map(|(_, peer)| *peer).ok_or_else(|| {
            format!("unknown peer '{name}': whole-frame; with --features peers rapier, parry, parry-queries")
        })
    }
}

pub enum Peer {
    Frame,
    #[cfg(feature = "peers")]
    Rapier(Box<Rapier>),
    #[cfg(feature = "peers")]
    Parry(Box<ParryScene>),
}

impl Peer {
    /// A peer that has these boxes.
    #[cfg_attr(not(feature = "peers"), expect(clippy::unnecessary_wraps))]
    pub fn new(
        name: PeerName,
        #[cfg_attr(not(feature = "peers"), expect(unused))] boxes: &[Aabb],
    ) -> Result<Self, Box<dyn Error>> {
        #[cfg(feature = "peers")]
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(match name {
            PeerName::Frame => Self::Frame,
            #[cfg(feature = "peers")]
            PeerName::Rapier => {
                let mut rapier = Rapier::new(boxes.len());
                rapier.change((0..).zip(boxes))?;
                Self::Rapier(Box::new(rapier))
            }
            #[cfg(feature = "peers")]
            PeerName::Parry => {
                Self::Parry(Box::new(ParryScene::new(boxes, ParryWay::Changes, threads)))
            }
            #[cfg(feature = "peers")]
            PeerName::ParryQueries => {
                Self::Parry(Box::new(ParryScene::new(boxes, ParryWay::Queries, threads)))
            }
        })
    }

    /// Makes the same change: boxes that moved are given, and what it tells is kept or visited.
    pub fn change(
        &mut self,
        session: &mut Session,
        boxes: &[Aabb],
        #[cfg_attr(not(feature = "peers"), expect(unused))] moved: &[u32],
    ) -> Result<(), Box<dyn Error>> {
        match self {
            Self::Frame => whole_frame(session, boxes).map(drop),
            #[cfg(feature = "peers")]
            Self::Rapier(rapier) => {
                let these = moved.iter().map(|i| (*i, &boxes[*i as usize]));
                black_box(rapier.change(these)?);
                Ok(())
            }
            #[cfg(feature = "peers")]
            Self::Parry(parry) => {
                black_box(parry.change(moved, boxes)?);
                Ok(())
            }
        }
    }
}

/// A whole frame, every pair visited: how many.
pub fn whole_frame(session: &mut Session, boxes: &[Aabb]) -> Result<u64, Box<dyn Error>> {
    let mut frame = session.frame(boxes.len())?;
    frame.boxes_mut().copy_from_slice(boxes);
    let mask = frame.submit()?.wait()?;
    let (mut sum, mut count) = (0u64, 0);
    mask.for_each_slice(|pairs| {
        sum = pairs.iter().fold(sum, |sum, [a, b]| sum + u64::from(a ^ b));
        count += pairs.len() as u64;
    });
    black_box(sum);
    Ok(count)
}
