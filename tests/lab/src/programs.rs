//! Programs as games, crowds, robots and trainers send boxes: sources of recordings. Each is seeded, and sends the same
//! requests each time. They stand for real programs, which are larger and less regular.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use pairmask::cast::{Hits, Ray};
use pairmask::filters::{Filter, FilterData, FilterId, FilterTable, Owner, Rules, World};
use pairmask::{
    Aabb, Bounds, FrameOptions, Margin, Precision, Report, SceneOptions, Session, Sphere,
};
use pairmaskd::scene::Random;

use crate::Result;

/// Every program has the same numbers each time.
const SEED: u64 = 42;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Program {
    /// Houses, cars on a grid of streets, people; a scene with margins, and lines of sight
    City,
    /// People on a square, as quantised frames
    Crowd,
    /// An arm of seven joints above full shelves; poses are tried as queries of a scene
    RobotArm,
    /// 48 worlds of a trainer in one frame, with filters that the daemon keeps
    RlBatch,
    /// Bubbles that rise, as frames of spheres
    Bubbles,
    /// A fight of two players, who go back to snapshots and play again
    Rollback,
    /// Sensors and what they sense, as frames of two sets
    Sensors,
}

impl Program {
    /// Steps, and how many there are a second.
    const fn steps(self) -> (u32, u32) {
        match self {
            Self::City | Self::Rollback => (120, 60),
            Self::Crowd | Self::RobotArm | Self::Sensors => (40, 20),
            Self::RlBatch | Self::Bubbles => (30, 30),
        }
    }

    /// Runs the program at its pace.
    ///
    /// # Errors
    /// The session's.
    pub fn run(self, session: &mut Session) -> Result<()> {
        let random = &mut Random::new(SEED);
        match self {
            Self::City => city(&mut Steps::of(self), session, random),
            Self::Crowd => crowd(&mut Steps::of(self), session, random),
            Self::RobotArm => robot_arm(&mut Steps::of(self), session, random),
            Self::RlBatch => rl_batch(&mut Steps::of(self), session, random),
            Self::Bubbles => bubbles(&mut Steps::of(self), session, random),
            Self::Rollback => rollback(&mut Steps::of(self), session, random),
            Self::Sensors => sensors(&mut Steps::of(self), session, random),
        }
    }
}

/// Steps at a pace.
struct Steps {
    begin: Instant,
    next: u32,
    count: u32,
    a_second: u32,
}

impl Steps {
    fn of(program: Program) -> Self {
        let (count, a_second) = program.steps();
        Self { begin: Instant::now(), next: 0, count, a_second }
    }
}

impl Iterator for Steps {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        let step = self.next;
        self.next += 1;
        let due = Duration::from_secs(1) * step / self.a_second;
        std::thread::sleep(due.saturating_sub(self.begin.elapsed()));
        (step < self.count).then_some(step)
    }
}

fn around(at: [f32; 3], half: [f32; 3]) -> Aabb {
    let corner = |sign: f32| std::array::from_fn(|axis| at[axis] + sign * half[axis]);
    Aabb::new(corner(-1.0), corner(1.0))
}

/// Places and velocities.
type Movers = Vec<([f32; 3], [f32; 3])>;

/// Moves within walls on the axes that have a velocity.
fn advance(movers: &mut Movers, extent: f32) {
    for (at, velocity) in movers {
        for axis in 0..3 {
            at[axis] += velocity[axis];
            if at[axis].abs() > extent {
                velocity[axis] = -velocity[axis];
            }
        }
    }
}

fn city(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const BLOCKS: i32 = 30;
    const STREET: f32 = 12.0;
    const CARS: u32 = 240;
    let mut houses = Vec::new();
    for x in -BLOCKS / 2..BLOCKS / 2 {
        for z in -BLOCKS / 2..BLOCKS / 2 {
            let height = random.range(3.0, 30.0);
            let at = [(x as f32 + 0.5) * STREET, height, (z as f32 + 0.5) * STREET];
            houses.push(around(at, [4.0, height, 4.0]));
        }
    }
    let extent = STREET * BLOCKS as f32 / 2.0;
    let street = |of: &mut Random| of.below(BLOCKS as u64) as f32 * STREET - extent;
    let mut movers: Movers = (0..CARS)
        .map(|i| {
            let (along, across) = (random.range(-extent, extent), street(random));
            let side = if i % 4 < 2 { 0.9 } else { -0.9 };
            let speed = random.range(0.1, 0.25) * f32::signum(side);
            match i % 2 {
                0 => ([along, 0.8, across + side], [speed, 0.0, 0.0]),
                _ => ([across + side, 0.8, along], [0.0, 0.0, speed]),
            }
        })
        .collect();
    let mut scene = session.scene(SceneOptions::default().with_margin(Margin::new(0.5)?))?;
    let first_car = houses.len() as u32;
    let all: Vec<u32> = (0..first_car).collect();
    let edit = scene.edit().set_all(&all[..], &houses).make_all_static(&all[..], true);
    drop(edit.commit(Report::Changes)?);
    for _ in steps {
        advance(&mut movers, extent);
        let cars: Vec<Aabb> = movers.iter().map(|(at, _)| around(*at, [0.8, 0.8, 0.8])).collect();
        let indices: Vec<u32> = (first_car..first_car + CARS).collect();
        drop(scene.edit().set_all(&indices[..], &cars).commit(Report::Changes)?);
        let sight = movers.iter().step_by(20).map(|(at, velocity)| {
            Ray::new([at[0], at[1] + 1.0, at[2]], velocity.map(|v| 10.0 * v)).up_to(40.0)
        });
        scene.cast(&sight.collect::<Vec<_>>(), Hits::Closest(1))?;
    }
    Ok(())
}

fn crowd(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const EXTENT: f32 = 12.0;
    let mut people: Movers = (0..500)
        .map(|_| {
            let at = [random.range(-EXTENT, EXTENT), 0.9, random.range(-EXTENT, EXTENT)];
            let [x, _, z] = random.direction();
            (at, [0.05 * x, 0.0, 0.05 * z])
        })
        .collect();
    let bounds =
        Bounds::new([-EXTENT - 1.0, 0.0, -EXTENT - 1.0], [EXTENT + 1.0, 2.0, EXTENT + 1.0])?;
    for _ in steps {
        advance(&mut people, EXTENT);
        let boxes: Vec<Aabb> = people.iter().map(|(at, _)| around(*at, [0.3, 0.9, 0.3])).collect();
        let mut frame = session.narrow_frame(boxes.len(), Precision::Q16(bounds))?;
        frame.write(&boxes)?;
        frame.submit()?.wait()?;
    }
    Ok(())
}

fn robot_arm(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const SHELVES: u32 = 400;
    const JOINTS: usize = 7;
    let mut scene = session.scene(SceneOptions::default())?;
    let goods: Vec<Aabb> = (0..SHELVES)
        .map(|i| {
            let (column, shelf) = (i % 40, i / 40);
            let half = [random.range(0.02, 0.06), random.range(0.03, 0.08), 0.05];
            around([column as f32 * 0.1 - 2.0, shelf as f32 * 0.25, 0.8], half)
        })
        .collect();
    let indices: Vec<u32> = (0..SHELVES).collect();
    drop(scene.edit().set_all(&indices[..], &goods).commit(Report::Changes)?);
    let pose = |angles: &[f32; JOINTS]| {
        let (mut at, mut turn) = ([0.0f32, 0.2, 0.0], 0.0);
        std::array::from_fn::<Aabb, JOINTS, _>(|joint| {
            turn += angles[joint];
            let (sin, cos) = f32::sin_cos(turn);
            let end = [at[0] + 0.2 * sin, at[1] + 0.1 * cos, at[2] + 0.15];
            let link = Aabb::new(
                std::array::from_fn::<f32, 3, _>(|axis| at[axis].min(end[axis]) - 0.05),
                std::array::from_fn::<f32, 3, _>(|axis| at[axis].max(end[axis]) + 0.05),
            );
            at = end;
            link
        })
    };
    let mut angles = [0.0; JOINTS];
    for step in steps {
        // Of sixteen poses the one that meets the fewest goods.
        let tried: Vec<[f32; JOINTS]> =
            (0..16).map(|_| angles.map(|angle| angle + random.range(-0.1, 0.1))).collect();
        let boxes: Vec<Aabb> = tried.iter().flat_map(pose).collect();
        let mut met = vec![0; tried.len()];
        scene.query(&boxes)?.iter().for_each(|[query, _]| met[query as usize / JOINTS] += 1);
        if let Some((_, best)) = met.iter().zip(&tried).min_by_key(|(met, _)| **met) {
            angles = *best;
        }
        // What it has taken goes.
        let mut edit = scene.edit();
        if step % 10 == 9 {
            edit = edit.remove(random.below(SHELVES.into()) as u32);
        }
        let links: Vec<u32> = (SHELVES..SHELVES + JOINTS as u32).collect();
        let now = pose(&angles);
        drop(edit.set_all(&links[..], &now).commit(Report::Changes)?);
    }
    Ok(())
}

fn rl_batch(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const WORLDS: i32 = 48;
    const BODIES: usize = 12;
    let mut rules = Rules::default();
    // Of each world: the ground, five of one walker, five of another, a wall.
    rules.table = FilterTable::new(&[Filter::new(1, 2), Filter::new(2, 3)])?;
    for world in 0..WORLDS {
        for body in 0..BODIES {
            let is_walker = (1..11).contains(&body);
            let owner =
                if is_walker { Owner(2 * world as u32 + 1 + body as u32 / 6) } else { Owner::NONE };
            let filter = FilterId(u16::from(is_walker));
            rules.filter_data.push(FilterData::new(World(world), owner, filter));
        }
    }
    let rules = Some(Arc::new(rules));
    let mut walkers: Movers = (0..2 * WORLDS)
        .map(|_| ([random.range(-2.0, 2.0), 0.5, 0.0], [random.range(-0.05, 0.05), 0.0, 0.0]))
        .collect();
    for step in steps {
        advance(&mut walkers, 3.0);
        let mut boxes = Vec::new();
        for pair in walkers.chunks(2) {
            boxes.push(around([0.0, -0.5, 0.0], [4.0, 0.5, 4.0]));
            for (at, _) in pair {
                for limb in 0..5 {
                    let swing = 0.3 * f32::sin(0.3 * step as f32 + limb as f32);
                    boxes.push(around([at[0] + swing, 0.1 + 0.2 * limb as f32, at[2]], [0.15; 3]));
                }
            }
            boxes.push(around([4.0, 1.0, 0.0], [0.2, 1.0, 4.0]));
        }
        let mut frame = session.frame(boxes.len())?;
        frame.write(&boxes)?;
        let options = FrameOptions { filters: rules.clone(), ..FrameOptions::default() };
        frame.submit_with(&options)?.wait()?;
    }
    Ok(())
}

fn bubbles(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    let mut all: Vec<Sphere> = (0..500)
        .map(|_| {
            let at = [(); 3].map(|()| random.range(-5.0, 5.0));
            Sphere::new(at, random.log_range(0.05, 0.6))
        })
        .collect();
    for _ in steps {
        for bubble in &mut all {
            // Large ones rise faster; what leaves comes back below.
            bubble.center[1] += 0.2 * bubble.radius;
            if bubble.center[1] > 5.0 {
                bubble.center[1] -= 10.0;
            }
        }
        let mut frame = session.sphere_frame(all.len())?;
        frame.spheres_mut().copy_from_slice(&all);
        frame.submit()?.wait()?;
    }
    Ok(())
}

fn rollback(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const SHOTS: u32 = 64;
    /// Steps that are played again where the other player's input was guessed wrong.
    const DEPTH: u32 = 4;
    let mut scene = session.scene(SceneOptions::default())?;
    let stage: Vec<Aabb> = (0..40)
        .map(|i| around([i as f32 - 20.0, random.range(0.0, 3.0), 0.0], [0.5, 0.2, 1.0]))
        .collect();
    let indices: Vec<u32> = (2..2 + stage.len() as u32).collect();
    let edit = scene.edit().set_all(&indices[..], &stage).make_all_static(&indices[..], true);
    drop(edit.commit(Report::Changes)?);
    let first_shot = 2 + stage.len() as u32;
    let step_on = |scene: &mut pairmask::Scene, step: u32, guess: f32| -> Result<()> {
        let time = step as f32 / 60.0;
        let fighters = [(time.sin() * 5.0 - 1.0, 0), ((time + guess).cos() * 5.0 + 1.0, 1)];
        let mut edit = scene.edit();
        for (x, index) in fighters {
            let height = 1.0 + (5.0 * time + index as f32).sin().abs();
            edit = edit.set(index, around([x, height, 0.0], [0.4, 0.9, 0.4]));
        }
        // Shots fly for 32 steps.
        for shot in 0..SHOTS {
            let age = (step + shot * 7) % 96;
            let index = first_shot + shot;
            edit = match age {
                0..32 => {
                    let x = shot as f32 / 2.0 - 16.0 + age as f32 * 0.3;
                    let at = [x, 1.0 + shot as f32 * 0.03, 0.0];
                    edit.set(index, around(at, [0.1; 3])).set_user_data(index, u64::from(step))
                }
                // In the first step none has flown yet.
                32 if step > 0 => edit.remove(index),
                _ => edit,
            };
        }
        drop(edit.commit(Report::Changes)?);
        Ok(())
    };
    let mut kept = None;
    for step in steps {
        if step % 10 == 0 {
            kept = Some((scene.snapshot()?, step));
        }
        step_on(&mut scene, step, 0.2)?;
        if let Some((snapshot, since)) = kept.filter(|(_, since)| step == since + DEPTH) {
            scene.restore(snapshot)?;
            (since..=step).try_for_each(|again| step_on(&mut scene, again, 0.0))?;
            scene.forget_snapshot(snapshot)?;
            kept = None;
        }
    }
    Ok(())
}

fn sensors(steps: &mut Steps, session: &mut Session, random: &mut Random) -> Result<()> {
    const SENSORS: usize = 100;
    let mut units: Movers = (0..400)
        .map(|i| {
            let at = [(); 3].map(|()| random.range(-20.0, 20.0));
            // Most of them stand.
            let speed = if i % 4 == 0 { 0.1 } else { 0.0 };
            (at, random.direction().map(|x| speed * x))
        })
        .collect();
    for _ in steps {
        advance(&mut units, 20.0);
        let sensed = units[..SENSORS].iter().map(|(at, _)| around(*at, [4.0, 2.0, 4.0]));
        let boxes: Vec<Aabb> =
            sensed.chain(units.iter().map(|(at, _)| around(*at, [0.5; 3]))).collect();
        let mut frame = session.frame(boxes.len())?;
        frame.write(&boxes)?;
        let options = FrameOptions { split_at: Some(SENSORS), ..FrameOptions::default() };
        frame.submit_with(&options)?.wait()?;
    }
    Ok(())
}
