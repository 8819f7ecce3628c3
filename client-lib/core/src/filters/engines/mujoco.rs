//! MuJoCo: contact types and affinities, as `filterBitmask` tests them; bodies, as `filterBodyPair` does; and
//! the lists of the model's `<contact>` section.

use std::collections::HashMap;

use super::{bits, owner_of};
use crate::filters::{Filter, Owner, PairLists};

/// The filter of a MuJoCo geom: its `contype` and `conaffinity`. Two meet where either has the other's type in
/// its affinity.
pub const fn from_mujoco(contype: i32, conaffinity: i32) -> Filter {
    Filter::new(bits(contype), bits(conaffinity)).with_either(true)
}

/// What a MuJoCo model says of bodies and lists, as `mjModel` names it.
#[derive(Clone, Copy, Debug, Default)]
pub struct MujocoBodies<'a> {
    /// The body of each geom: `geom_bodyid`.
    pub geom_body: &'a [u32],
    /// The body that each body is welded to, itself or the world, 0: `body_weldid`.
    pub body_weld: &'a [u32],
    /// The parent of each body: `body_parentid`.
    pub body_parent: &'a [u32],
    /// Whether parents and children may meet: the flag `filterparent` is disabled.
    pub parents_meet: bool,
    /// Pairs of bodies of which no geoms meet: `<exclude>`.
    pub excluded_bodies: &'a [[u32; 2]],
    /// Pairs of geoms that meet regardless of what else is said: `<pair>`.
    pub geom_pairs: &'a [[u32; 2]],
}

/// A model that names what it does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MujocoError {
    /// A body beyond the arrays of bodies, which have to be as long as each other.
    #[error("body {0} is not in the model")]
    NoBody(u32),
    /// A geom beyond the array of geoms.
    #[error("geom {0} is not in the model")]
    NoGeom(u32),
}

/// The owners of a MuJoCo model's geoms, and its lists of geoms.
///
/// Geoms of bodies that are welded together share an owner, those of the world among them. Geoms of a body and
/// its parent are on the exclude list, unless one of them is welded to the world or the model lets them meet.
///
/// # Errors
/// [`MujocoError`] where the model names a body or geom that it does not have.
pub fn from_mujoco_bodies(
    model: &MujocoBodies<'_>,
) -> Result<(Vec<Owner>, PairLists), MujocoError> {
    let body_count = model.body_weld.len().min(model.body_parent.len());
    let body = |index: u32| {
        if (index as usize) < body_count { Ok(index) } else { Err(MujocoError::NoBody(index)) }
    };
    let geom = |index: u32| {
        let is_there = (index as usize) < model.geom_body.len();
        if is_there { Ok(index) } else { Err(MujocoError::NoGeom(index)) }
    };
    let weld = |index: u32| body(model.body_weld[body(index)? as usize]);

    let mut owners = Vec::with_capacity(model.geom_body.len());
    let (mut of_body, mut of_weld) = (Geoms::default(), Geoms::default());
    for (index, on) in (0..).zip(model.geom_body) {
        let welded_to = weld(*on)?;
        owners.push(owner_of(welded_to));
        of_body.entry(*on).or_default().push(index);
        of_weld.entry(welded_to).or_default().push(index);
    }

    let mut lists = PairLists::new();
    if !model.parents_meet {
        for child in of_weld.keys().filter(|child| **child != 0) {
            let parent = weld(body(model.body_parent[*child as usize])?)?;
            if parent != 0 && parent != *child {
                exclude_all(&mut lists, &of_weld, [*child, parent]);
            }
        }
    }
    for [a, b] in model.excluded_bodies {
        exclude_all(&mut lists, &of_body, [body(*a)?, body(*b)?]);
    }
    for [a, b] in model.geom_pairs {
        lists.include([geom(*a)?, geom(*b)?], true);
    }
    Ok((owners, lists))
}

type Geoms = HashMap<u32, Vec<u32>>;

/// Puts all geoms of two bodies on the exclude list.
fn exclude_all(lists: &mut PairLists, geoms: &Geoms, bodies: [u32; 2]) {
    let [ones, others] = bodies.map(|body| geoms.get(&body).map_or(&[][..], Vec::as_slice));
    for one in ones {
        for other in others {
            lists.exclude([*one, *other], true);
        }
    }
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use super::*;
    use crate::filters::engines::testing::{Random, check};
    use crate::filters::{FilterData, FilterId, FilterTable, Rules, World};

    #[test]
    fn mujoco_types_meet_as_in_mujoco() {
        let field = |random: &mut Random| (random.int(), random.int());
        let meet = |a: &(i32, i32), b: &(i32, i32)| !((a.0 & b.1) == 0 && (b.0 & a.1) == 0);
        check(field, |&(contype, conaffinity)| from_mujoco(contype, conaffinity), meet);
    }

    #[test]
    fn mujoco_models_meet_as_in_mujoco() {
        let mut random = Random(17 << 40);
        let mut reasons = [0; 5];
        for round in 0..40 {
            let bodies = 12;
            // A parent comes before its children; a body without a joint is welded to its parent's weld.
            let body_parent: Vec<u32> =
                (0..bodies).map(|body: u32| random.next() as u32 % body.max(1)).collect();
            let mut body_weld: Vec<u32> = vec![0];
            for body in 1..bodies {
                let is_welded = random.next().is_multiple_of(3);
                let parent = body_parent[body as usize] as usize;
                body_weld.push(if is_welded { body_weld[parent] } else { body });
            }
            let geom_body: Vec<u32> = (0..40).map(|_| random.next() as u32 % bodies).collect();
            let types: Vec<(i32, i32)> =
                (0..40).map(|_| (random.small() & 3, random.small() & 3)).collect();
            let mut two = |below: u64| [0; 2].map(|_| (random.next() % below) as u32);
            let model = MujocoBodies {
                geom_body: &geom_body,
                body_weld: &body_weld,
                body_parent: &body_parent,
                parents_meet: round % 4 == 0,
                excluded_bodies: &[two(12), two(12), two(12)],
                geom_pairs: &[two(40), two(40), two(40), two(40)],
            };
            let (owners, lists) = from_mujoco_bodies(&model).expect("a model");
            let filters: Vec<Filter> =
                types.iter().map(|geom| from_mujoco(geom.0, geom.1)).collect();
            let mut rules = Rules::default();
            rules.table = FilterTable::new(&filters).expect("few filters");
            rules.filter_data = (0..)
                .zip(&owners)
                .map(|(at, owner)| FilterData::new(World(0), *owner, FilterId(at)))
                .collect();
            rules.lists = lists;
            for a in 0..40 {
                for b in (0..40).filter(|b| *b != a) {
                    let (expected, reason) = naive(&model, &types, a, b);
                    assert_eq!(rules.meet(a, b), expected, "{a} and {b} of {model:?}");
                    reasons[reason] += 1;
                }
            }
        }
        assert!(reasons.iter().all(|count| *count > 50), "{reasons:?}");
    }

    /// Whether two geoms meet, and which step said so.
    fn naive(model: &MujocoBodies<'_>, types: &[(i32, i32)], a: u32, b: u32) -> (bool, usize) {
        let has = |list: &[[u32; 2]], a, b| list.contains(&[a, b]) || list.contains(&[b, a]);
        if has(model.geom_pairs, a, b) {
            return (true, 0);
        }
        let [body1, body2] = [a, b].map(|geom| model.geom_body[geom as usize]);
        let [weld1, weld2] = [body1, body2].map(|body| model.body_weld[body as usize]);
        let weld_parent = |weld: u32| model.body_weld[model.body_parent[weld as usize] as usize];
        if weld1 == weld2 {
            return (false, 1);
        }
        let is_parent = weld1 == weld_parent(weld2) || weld2 == weld_parent(weld1);
        if !model.parents_meet && weld1 != 0 && weld2 != 0 && is_parent {
            return (false, 2);
        }
        if has(model.excluded_bodies, body1, body2) {
            return (false, 3);
        }
        let (one, other) = (types[a as usize], types[b as usize]);
        (one.0 & other.1 != 0 || other.0 & one.1 != 0, 4)
    }

    #[test]
    fn a_model_that_names_what_it_lacks_is_refused() {
        let model = MujocoBodies {
            geom_body: &[0, 1],
            body_weld: &[0, 1],
            body_parent: &[0, 0],
            ..MujocoBodies::default()
        };
        assert!(from_mujoco_bodies(&model).is_ok());
        let wrong = |model: MujocoBodies<'_>| from_mujoco_bodies(&model).err();
        assert_eq!(wrong(MujocoBodies { geom_body: &[2], ..model }), Some(MujocoError::NoBody(2)));
        assert_eq!(
            wrong(MujocoBodies { body_weld: &[0, 9], ..model }),
            Some(MujocoError::NoBody(9))
        );
        assert_eq!(
            wrong(MujocoBodies { body_parent: &[0], ..model }),
            Some(MujocoError::NoBody(1))
        );
        let far = [[0, u32::MAX]];
        assert_eq!(
            wrong(MujocoBodies { excluded_bodies: &far, ..model }),
            Some(MujocoError::NoBody(u32::MAX))
        );
        assert_eq!(
            wrong(MujocoBodies { geom_pairs: &far, ..model }),
            Some(MujocoError::NoGeom(u32::MAX))
        );
    }
}
