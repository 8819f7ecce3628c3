//! Requests that wait, and whose turn it is. One file: the turns are a few rules that change the same numbers, and half
//! of it are their tests.

use std::time::{Duration, Instant};

use pairmask_transport::Sender;
use pairmask_wire::board::PLACES;

/// A request that waits counts as if its process had used so much less: this part of the time that it has waited.
///
/// So a process that is ahead of the others by some time waits at most eight times as long as that, however many
/// others come meanwhile, beside what is being served and what waited before: without it, one whose frame took 10 s
/// would wait until each of the others had used 10 s too. A larger part would give long frames, which wait longer,
/// more than their share: this one gives 38 % in place of 33 % to the largest of three.
const WAITED_COUNTS: u32 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resource {
    /// A core: many at a time.
    Core,
    /// All threads of the engines: one at a time, or a core where it is not worth while to wait for them.
    Pool,
    /// A GPU: as many at a time as there are. Threads that waited for one beside would slow those that
    /// have one.
    Gpu,
}

#[derive(Debug)]
struct Waiting<R> {
    sender: Sender,
    process_turn: u64,
    session_turn: u64,
    resource: Resource,
    since: Instant,
    request: R,
}

#[derive(Debug)]
struct Serving {
    sender: Sender,
    resource: Resource,
    /// Frames that are served together have the same.
    task: u64,
}

/// What a process has used, counted from where the [clock](RequestQueue::clock) stood when it came.
#[derive(Debug)]
struct Account {
    process: u32,
    used: Duration,
}

/// Requests that wait for an answer, and the sessions that are being answered.
///
/// Processes share the time of those who serve, regardless of what they say and however many sessions they have: of
/// two that wait, the one is next that has used less, where a part of the time counts that each has waited; of
/// equals, the one that has waited longer. None starves. A process that has been away has no time saved up. The sessions of a process take turns; a session has
/// one frame served at a time, and its requests keep their order. What all frames of
/// a kind share is given to one at a time ([`Resource`]).
#[derive(Debug)]
pub struct RequestQueue<R> {
    /// Oldest first.
    waiting: Vec<Waiting<R>>,
    serving: Vec<Serving>,
    accounts: Vec<Account>,
    /// What the process had used that was served last: where those begin that come from now on. (The
    /// virtual time of start-time fair queueing: Goyal, Vin, Cheng, 1996.)
    clock: Duration,
    capacity: usize,
    /// Frames that GPUs serve at a time.
    gpus: usize,
    last_turn: u64,
    /// Number of the request that was given out last, with those that are served together with it.
    last_task: u64,
}

impl<R> RequestQueue<R> {
    /// Room for all requests that `max_clients` may have under way: one client cannot fill it, and
    /// requests of others are received all the same.
    pub fn new(max_clients: usize, gpus: usize) -> Self {
        let capacity = max_clients.max(1) * PLACES;
        Self {
            waiting: Vec::with_capacity(capacity),
            serving: Vec::with_capacity(capacity),
            accounts: Vec::with_capacity(capacity),
            clock: Duration::ZERO,
            capacity,
            gpus: gpus.max(1),
            last_turn: 0,
            last_task: 0,
        }
    }

    pub fn room(&self) -> usize {
        self.capacity.saturating_sub(self.waiting.len())
    }

    pub fn is_served(&self, session: u64) -> bool {
        self.serving.iter().any(|serving| serving.sender.session == session)
    }

    pub fn serving(&self) -> usize {
        self.serving.len()
    }

    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    pub fn put(&mut self, sender: Sender, resource: Resource, request: R, now: Instant) {
        let Sender { session, process } = sender;
        self.open_account(process);
        let of_process = self.waiting.iter().find(|w| w.sender.process == process);
        let process_turn = of_process.map(|w| w.process_turn);
        let of_session = self
            .waiting
            .iter()
            .find(|w| (w.sender.process, w.sender.session) == (process, session));
        let session_turn = of_session.map(|w| w.session_turn);
        self.last_turn += 1;
        self.waiting.push(Waiting {
            sender,
            process_turn: process_turn.unwrap_or(self.last_turn),
            session_turn: session_turn.unwrap_or(self.last_turn),
            resource,
            since: now,
            request,
        });
    }

    /// The oldest request of the session whose turn it is, of those that `may_be_served` and can be beside what is
    /// being served, and what it is to be served by: a core in place of the pool, where that is taken and the request
    /// has waited for it `too_long`. Its session has no other one served until [`Self::note_served`].
    pub fn next(
        &mut self,
        now: Instant,
        may_be_served: impl Fn(&R) -> bool,
        too_long: impl Fn(&R, Duration) -> bool,
    ) -> Option<(Sender, Resource, R)> {
        let is_taken = |resource| {
            let most = match resource {
                Resource::Core => return false,
                Resource::Pool => 1,
                Resource::Gpu => self.gpus,
            };
            self.tasks_of(resource) >= most
        };
        let goes_alone = |w: &Waiting<R>| {
            w.resource == Resource::Pool
                && too_long(&w.request, now.saturating_duration_since(w.since))
        };
        let turn = self.next_of(now, |w| {
            (!is_taken(w.resource) || goes_alone(w)) && may_be_served(&w.request)
        })?;
        let resource = self.waiting[turn].resource;
        let resource = if is_taken(resource) { Resource::Core } else { resource };
        self.waiting[turn].resource = resource;
        self.last_task += 1;
        let (sender, request) = self.give(turn);
        Some((sender, resource, request))
    }

    /// What a resource serves; frames that it serves together count once.
    fn tasks_of(&self, resource: Resource) -> usize {
        let counts = |&(at, serving): &(usize, &Serving)| {
            let is_first = !self.serving[..at].iter().any(|other| other.task == serving.task);
            serving.resource == resource && is_first
        };
        self.serving.iter().enumerate().filter(counts).count()
    }

    /// As [`Self::next`], of those to be served together with the request given out last.
    pub fn next_beside(
        &mut self,
        now: Instant,
        resource: Resource,
        can_join: impl Fn(&R) -> bool,
    ) -> Option<(Sender, R)> {
        let turn = self.next_of(now, |w| w.resource == resource && can_join(&w.request))?;
        Some(self.give(turn))
    }

    /// Where the request waits whose turn it is, of the oldest ones of their sessions that can be served.
    fn next_of(&self, now: Instant, can_be_served: impl Fn(&Waiting<R>) -> bool) -> Option<usize> {
        let is_oldest = |at: usize, session: u64| {
            !self.waiting[..at].iter().any(|older| older.sender.session == session)
        };
        let turns = self.waiting.iter().enumerate().filter(|(at, w)| {
            let session = w.sender.session;
            !self.is_served(session) && can_be_served(w) && is_oldest(*at, session)
        });
        let turn =
            turns.min_by_key(|(_, w)| (self.lead_of(w, now), w.process_turn, w.session_turn));
        turn.map(|(turn, _)| turn)
    }

    fn give(&mut self, turn: usize) -> (Sender, R) {
        let served = self.waiting.remove(turn);
        self.last_turn += 1;
        let Sender { process, session, .. } = served.sender;
        for left in self.waiting.iter_mut().filter(|w| w.sender.process == process) {
            left.process_turn = self.last_turn;
            if left.sender.session == session {
                left.session_turn = self.last_turn;
            }
        }
        self.clock = self.used_by(process).max(self.clock);
        let (resource, task) = (served.resource, self.last_task);
        self.serving.push(Serving { sender: served.sender, resource, task });
        (served.sender, served.request)
    }

    pub fn note_served(&mut self, sender: Sender, used: Duration) {
        if let Some(at) = self.serving.iter().position(|s| s.sender.session == sender.session) {
            self.serving.swap_remove(at);
        }
        if let Some(account) = self.accounts.iter_mut().find(|a| a.process == sender.process) {
            account.used += used;
        }
    }

    /// A process begins to wait, or goes on to.
    fn open_account(&mut self, process: u32) {
        let Self { waiting, serving, accounts, clock, .. } = self;
        let is_active = |process| {
            waiting.iter().any(|w| w.sender.process == process)
                || serving.iter().any(|s| s.sender.process == process)
        };
        if let Some(account) = accounts.iter_mut().find(|account| account.process == process) {
            if !is_active(process) {
                // Time that it did not use while it was away is not saved up.
                account.used = account.used.max(*clock);
            }
            return;
        }
        // What is not ahead of the clock would be opened in the same way. What is ahead belongs to those
        // that were here of late; there are no more processes than clients, unless they come and go.
        let is_full = accounts.len() >= accounts.capacity();
        accounts.retain(|a| is_active(a.process) || a.used > *clock && !is_full);
        accounts.push(Account { process, used: *clock });
    }

    /// What a request's process has used, less a part of what it has waited, ns: the least is next.
    fn lead_of(&self, waiting: &Waiting<R>, now: Instant) -> i128 {
        let waited = now.saturating_duration_since(waiting.since) / WAITED_COUNTS;
        let ns = |time: Duration| i128::try_from(time.as_nanos()).unwrap_or(i128::MAX);
        ns(self.used_by(waiting.sender.process)).saturating_sub(ns(waited))
    }

    fn used_by(&self, process: u32) -> Duration {
        let account = self.accounts.iter().find(|account| account.process == process);
        account.map_or(self.clock, |account| account.used)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: Duration = Duration::from_micros(1);

    fn sender(process: u32, session: u64) -> Sender {
        Sender { session, process }
    }

    /// The next request, served at once, for so long.
    fn serve<R>(queue: &mut RequestQueue<R>, now: Instant, used: Duration) -> Option<R> {
        let (sender, _, request) = queue.next(now, |_| true, |_, _| false)?;
        queue.note_served(sender, used);
        Some(request)
    }

    /// Plays a script, for processes of one session each, while no time passes. `+1Pa` puts a request `a` of process 1
    /// for the pool (`C` a core, `G` a GPU, `g` one that others may join), `>1a` has it given out next, `&1a` beside
    /// the last one, `>.` and `&.` none, and `-1` says that it was served.
    fn play(gpus: usize, script: &str) {
        let (mut queue, now) = (RequestQueue::new(4, gpus), Instant::now());
        for word in script.split_whitespace() {
            let id = word[1..2].parse().unwrap_or(0);
            let (from, expected) = (sender(id, id.into()), (id > 0).then_some(&word[1..]));
            let name =
                |(from, request): (Sender, &str)| format!("{}{}", from.session, &request[3..]);
            let found = match &word[..1] {
                "+" => {
                    let resource = match &word[2..3] {
                        "P" => Resource::Pool,
                        "C" => Resource::Core,
                        _ => Resource::Gpu,
                    };
                    queue.put(from, resource, word, now);
                    continue;
                }
                ">" => queue.next(now, |_| true, |_, _| false).map(|(from, _, r)| (from, r)),
                "&" => queue.next_beside(now, Resource::Gpu, |request| request.contains('g')),
                _ => {
                    queue.note_served(from, US);
                    continue;
                }
            };
            assert_eq!(found.map(name).as_deref(), expected, "{word} of {script}");
        }
    }

    #[test]
    fn requests_wait_for_their_session_and_for_what_is_taken() {
        for (gpus, script) in [
            // A session has one frame served at a time, in its order.
            (1, "+1Ca +1Cb +2Cc >1a >2c >. -2 >. -1 >1b"),
            // Large frames are served one at a time, and small ones beside them.
            (1, "+1P +2P +3C >1 >3 >. -1 >2"),
            // A resource that is taken is waited for, and others are not.
            (1, "+1G +2G +3P +4C >1 >3 >4 >. -3 >. -1 >2"),
            // What a resource serves together is given out beside it, and taken until all of it is served.
            (1, "+1ga +1gb +2C +3G +4g >1a &4 &. >2 >. -4 >. -1 >3"),
            // Each GPU serves one at a time, and what goes with it.
            (2, "+1G +2g +3G +4G >1 &2 >3 >. -1 >. -2 >4"),
            // None overtakes an older one of its session that waits for a resource.
            (1, "+2P >2 +1Po +1Cn >. -2 >1o"),
        ] {
            play(gpus, script);
        }
    }

    #[test]
    fn a_process_with_many_sessions_has_one_turn() {
        let now = Instant::now();
        let mut queue = RequestQueue::new(4, 1);
        for session in 10..18 {
            queue.put(sender(1, session), Resource::Core, (1, session), now);
            queue.put(sender(1, session), Resource::Core, (1, session), now);
        }
        let mut order = Vec::new();
        for _ in 0..4 {
            // A process that asks again as soon as it is answered.
            queue.put(sender(2, 1), Resource::Core, (2, 1), now);
            order.extend(
                [serve(&mut queue, now, US), serve(&mut queue, now, US)].into_iter().flatten(),
            );
        }
        let processes: Vec<u32> = order.iter().map(|(process, _)| *process).collect();
        assert_eq!(processes, [1, 2, 1, 2, 1, 2, 1, 2]);
        let sessions: Vec<u64> = order.iter().filter(|o| o.0 == 1).map(|o| o.1).collect();
        assert_eq!(sessions, [10, 11, 12, 13], "the sessions of a process take turns as well");
    }

    #[test]
    fn newcomers_do_not_overtake_those_who_used_no_more() {
        let now = Instant::now();
        let mut queue = RequestQueue::new(8, 1);
        queue.put(sender(500, 1), Resource::Core, 500, now);
        queue.put(sender(500, 1), Resource::Core, 500, now);
        assert_eq!(serve(&mut queue, now, Duration::ZERO), Some(500));
        for process in [1, 900] {
            queue.put(sender(process, 2), Resource::Core, process, now);
        }
        let order = [(); 3].map(|()| serve(&mut queue, now, US));
        assert_eq!(order, [Some(500), Some(1), Some(900)]);
    }

    #[test]
    fn time_away_is_not_saved_up() {
        let now = Instant::now();
        let mut queue = RequestQueue::new(4, 1);
        let [busy, back] = [sender(1, 1), sender(2, 2)];
        queue.put(back, Resource::Core, back, now);
        assert_eq!(serve(&mut queue, now, US), Some(back));
        for _ in 0..1000 {
            queue.put(busy, Resource::Core, busy, now);
            serve(&mut queue, now, 100 * US);
        }
        // Both wait from now on: the one that was away gets no thousand turns first.
        let mut turns = 0;
        queue.put(busy, Resource::Core, busy, now);
        for _ in 0..20 {
            queue.put(back, Resource::Core, back, now);
            if serve(&mut queue, now, 100 * US) == Some(busy) {
                turns += 1;
                queue.put(busy, Resource::Core, busy, now);
            }
        }
        assert!(turns >= 8, "{turns} of 20");
    }

    #[test]
    fn memory_does_not_grow() {
        let now = Instant::now();
        let mut queue = RequestQueue::new(1, 1);
        let room = (queue.waiting.capacity(), queue.accounts.capacity());
        for process in 0..10_000 {
            queue.put(sender(process, u64::from(process)), Resource::Core, process, now);
            assert_eq!(serve(&mut queue, now, 1000 * US), Some(process));
        }
        assert_eq!((queue.waiting.capacity(), queue.accounts.capacity()), room);
    }

    #[test]
    fn a_request_that_waits_is_served_however_many_come_after_it() {
        let (start, ms) = (Instant::now(), Duration::from_millis(1));
        let mut queue = RequestQueue::new(64, 1);
        let large = sender(1, 1);
        queue.put(large, Resource::Pool, large, start);
        assert!(queue.next(start, |_| true, |_, _| false).is_some());
        queue.note_served(large, 2000 * ms);
        queue.put(large, Resource::Pool, large, start);
        // Forty others have a request each that waits, at any time, and take little.
        let mut now = start;
        for process in 2..42 {
            queue.put(sender(process, 2), Resource::Core, sender(process, 2), now);
        }
        let mut turns = 0;
        loop {
            now += ms;
            let (served, ..) = queue.next(now, |_| true, |_, _| false).expect("all wait");
            queue.note_served(served, ms);
            if served == large {
                break;
            }
            turns += 1;
            queue.put(served, Resource::Core, served, now);
        }
        // Until each of them had used as much it were 80 s.
        let waited = now - start;
        assert!(waited <= 2001 * ms * WAITED_COUNTS && turns > 8000, "{waited:?}, {turns} turns");
    }

    /// While no time passes, all have the same; as it passes, the largest gets a little more, for it waits longest.
    #[test]
    fn processes_that_always_wait_get_about_equal_time_however_long_their_frames() {
        let (start, costs) = (Instant::now(), [100 * US, 10 * US, US]);
        for passes in [false, true] {
            let (mut queue, mut now, mut used) =
                (RequestQueue::new(4, 1), start, [Duration::ZERO; 3]);
            for process in 0..3 {
                queue.put(sender(process, u64::from(process)), Resource::Core, process, now);
            }
            for _ in 0..10_000 {
                let next = queue.next(now, |_| true, |_, _| false);
                let (from, _, process) = next.expect("all wait");
                let cost = costs[process as usize];
                now += cost * u32::from(passes);
                queue.note_served(from, cost);
                used[process as usize] += cost;
                queue.put(from, Resource::Core, process, now);
            }
            let share = used[0].as_secs_f64() / used.iter().sum::<Duration>().as_secs_f64();
            assert!((0.3..0.42).contains(&share), "{share}");
            used.sort_unstable();
            assert!(passes || used[2] <= used[0] + 2 * costs[0], "{used:?}");
        }
    }

    #[test]
    fn what_may_not_be_served_now_waits_and_lets_others_pass() {
        let now = Instant::now();
        let mut queue = RequestQueue::new(4, 1);
        let [a, b] = [1, 2].map(|id| sender(id, u64::from(id)));
        queue.put(a, Resource::Core, "long", now);
        queue.put(b, Resource::Core, "short", now);
        let mut next = |may: &dyn Fn(&&str) -> bool| queue.next(now, may, |_, _| false);
        let core = Resource::Core;
        assert_eq!(next(&|request| *request == "short"), Some((b, core, "short")));
        assert_eq!(next(&|request| *request == "short"), None);
        assert_eq!(next(&|_| true), Some((a, core, "long")));
    }

    #[test]
    fn a_request_that_has_waited_for_the_pool_too_long_has_a_core() {
        let (start, ms) = (Instant::now(), Duration::from_millis(1));
        let mut queue = RequestQueue::new(4, 1);
        let [a, b, c] = [1, 2, 3].map(|id| sender(id, u64::from(id)));
        for (sender, resource, work) in
            [(a, Resource::Pool, 5000), (b, Resource::Pool, 7), (c, Resource::Gpu, 7)]
        {
            queue.put(sender, resource, work * ms, start);
        }
        let mut next_at = |later: u32| {
            let next = queue.next(start + later * ms, |_| true, |work, waited| waited > *work);
            next.map(|(sender, resource, _)| (sender, resource))
        };
        assert_eq!(next_at(0), Some((a, Resource::Pool)));
        assert_eq!(next_at(0), Some((c, Resource::Gpu)));
        assert_eq!(next_at(7), None);
        assert_eq!(next_at(8), Some((b, Resource::Core)));
        queue.put(c, Resource::Gpu, ms, start);
        queue.note_served(b, ms);
        queue.put(b, Resource::Pool, 7 * ms, start + 20 * ms);
        let next = queue.next(start + 21 * ms, |_| true, |_, _| false);
        assert_eq!(next, None, "the first one still has the pool, and the GPU is waited for");
        queue.note_served(a, ms);
        let next = queue.next(start + 21 * ms, |_| true, |_, _| false);
        assert_eq!(next, Some((b, Resource::Pool, 7 * ms)));
    }
}
