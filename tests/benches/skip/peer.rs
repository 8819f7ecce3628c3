//! What a scene is set beside: whole frames, or another library's broad phase in the same state.

use std::error::Error;
use std::hint::black_box;

use pairmask::{Aabb, Session};
#[cfg(feature = "peers")]
use pairmask_tests::peers::contender::Contender;
#[cfg(feature = "peers")]
use pairmask_tests::peers::parry_scene::{ParryScene, ParryWay};
#[cfg(feature = "peers")]
use pairmask_tests::peers::rapier::Rapier;

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PeerName {
    /// A frame of the same session
    #[value(alias = "frame")]
    WholeFrame,
    #[cfg(feature = "peers")]
    Rapier,
    #[cfg(feature = "peers")]
    Parry,
    #[cfg(feature = "peers")]
    ParryQueries,
}

pub enum Peer {
    Frame,
    #[cfg(feature = "peers")]
    Rapier(Box<Rapier>),
    #[cfg(feature = "peers")]
    Parry(Box<ParryScene>),
}

impl Peer {
    #[cfg_attr(not(feature = "peers"), expect(clippy::unnecessary_wraps))]
    pub fn new(
        name: PeerName,
        #[cfg_attr(not(feature = "peers"), expect(unused))] boxes: &[Aabb],
    ) -> Result<Self, Box<dyn Error>> {
        #[cfg(feature = "peers")]
        let parry = |way| {
            let threads = std::thread::available_parallelism().map_or(1, usize::from);
            Self::Parry(Box::new(ParryScene::new(boxes, way, threads)))
        };
        Ok(match name {
            PeerName::WholeFrame => Self::Frame,
            #[cfg(feature = "peers")]
            PeerName::Rapier => {
                let mut rapier = Rapier::new(boxes.len());
                rapier.change((0..).zip(boxes))?;
                Self::Rapier(Box::new(rapier))
            }
            #[cfg(feature = "peers")]
            PeerName::Parry => parry(ParryWay::Changes),
            #[cfg(feature = "peers")]
            PeerName::ParryQueries => parry(ParryWay::Queries),
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
            Self::Frame => drop(whole_frame(session, boxes)?),
            #[cfg(feature = "peers")]
            Self::Rapier(rapier) => {
                black_box(rapier.change(moved.iter().map(|i| (*i, &boxes[*i as usize])))?);
            }
            #[cfg(feature = "peers")]
            Self::Parry(parry) => {
                black_box(parry.change(moved, boxes)?);
            }
        }
        Ok(())
    }

    #[cfg_attr(not(feature = "peers"), expect(clippy::unnecessary_wraps, unused))]
    pub fn pairs(&mut self, boxes: &[Aabb]) -> Result<Option<u64>, Box<dyn Error>> {
        Ok(match self {
            Self::Frame => None,
            #[cfg(feature = "peers")]
            Self::Rapier(rapier) => Some(rapier.pairs(boxes)?.len() as u64),
            #[cfg(feature = "peers")]
            Self::Parry(parry) => Some(parry.pairs().len() as u64),
        })
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
