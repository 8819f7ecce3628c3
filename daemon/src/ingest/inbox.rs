//! Requests that wait, and whose turn it is.

use pairmask_transport::{FRAMES_AT_A_TIME, PORTS_PER_CLIENT, Sender};

/// A request that waits, and the turns in which its process and its session wait.
#[derive(Debug)]
struct Waiting<R> {
    process: u32,
    session: u128,
    process_turn: u64,
    session_turn: u64,
    request: R,
}

/// Requests that wait for an answer. Processes take turns, whatever they say and however many ports
/// they have; so do the sessions of a process; a session's own requests keep their order.
///
/// A process that was served, or begins to wait, goes to the end of the line: it waits for one turn
/// of each other process at most.
///
/// ```
/// use pairmask_transport::Sender;
/// let mut inbox = pairmaskd::ingest::Inbox::new(2);
/// let from = |process, port| Sender { port, session: port, process };
/// for (sender, request) in [
///     (from(7, 1), "a"),
///     (from(7, 1), "b"),
///     (from(7, 2), "c"),
///     (from(9, 3), "d"),
/// ] {
///     inbox.put(sender, request);
/// }
/// let order: Vec<&str> = std::iter::from_fn(|| inbox.next()).collect();
/// assert_eq!(order, ["a", "d", "c", "b"]);
/// ```
#[derive(Debug)]
pub struct Inbox<R> {
    /// Oldest first.
    waiting: Vec<Waiting<R>>,
    capacity: usize,
    /// Number of the turn at the end of the line.
    last_turn: u64,
}

impl<R> Inbox<R> {
    /// Room for all requests that `max_clients` may have under way: one client cannot fill it, and
    /// requests of others are received all the same.
    pub fn new(max_clients: usize) -> Self {
        let capacity = max_clients.max(1) * PORTS_PER_CLIENT * FRAMES_AT_A_TIME;
        Self { waiting: Vec::with_capacity(capacity), capacity, last_turn: 0 }
    }

    /// Requests that it has room for.
    pub const fn capacity(&self) -> usize {
        self.capacity
    }

    /// Whether another request may be put in without growing.
    pub fn has_room(&self) -> bool {
        self.waiting.len() < self.capacity
    }

    /// Takes in a request.
    pub fn put(&mut self, sender: Sender, request: R) {
        let Sender { session, process, .. } = sender;
        let of_process = self.waiting.iter().find(|w| w.process == process);
        let process_turn = of_process.map(|w| w.process_turn);
        let of_session = self.waiting.iter().find(|w| w.process == process && w.session == session);
        let session_turn = of_session.map(|w| w.session_turn);
        self.last_turn += 1;
        self.waiting.push(Waiting {
            process,
            session,
            process_turn: process_turn.unwrap_or(self.last_turn),
            session_turn: session_turn.unwrap_or(self.last_turn),
            request,
        });
    }

    /// The oldest request of the session whose turn it is.
    #[allow(clippy::should_implement_trait)] // An iterator would borrow the inbox between turns.
    pub fn next(&mut self) -> Option<R> {
        // `min_by_key` keeps the first of equals: the oldest of that session.
        let turns = self.waiting.iter().enumerate();
        let (turn, _) = turns.min_by_key(|(_, w)| (w.process_turn, w.session_turn))?;
        let served = self.waiting.remove(turn);
        self.last_turn += 1;
        for left in self.waiting.iter_mut().filter(|w| w.process == served.process) {
            left.process_turn = self.last_turn;
            if left.session == served.session {
                left.session_turn = self.last_turn;
            }
        }
        Some(served.request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sender(process: u32, port: u128) -> Sender {
        Sender { port, session: port, process }
    }

    #[test]
    fn a_process_with_many_ports_has_one_turn() {
        let mut inbox = Inbox::new(4);
        for port in 10..18 {
            inbox.put(sender(1, port), (1, port));
            inbox.put(sender(1, port), (1, port));
        }
        let mut order = Vec::new();
        for _ in 0..4 {
            // A process that asks again as soon as it is answered.
            inbox.put(sender(2, 1), (2, 1));
            order.extend([inbox.next(), inbox.next()].into_iter().flatten());
        }
        let processes: Vec<u32> = order.iter().map(|(process, _)| *process).collect();
        assert_eq!(processes, [1, 2, 1, 2, 1, 2, 1, 2]);
        let ports: Vec<u128> = order.iter().filter(|o| o.0 == 1).map(|o| o.1).collect();
        assert_eq!(ports, [10, 11, 12, 13], "the sessions of a process take turns as well");
    }

    #[test]
    fn newcomers_do_not_overtake() {
        let mut inbox = Inbox::new(8);
        inbox.put(sender(500, 1), 500);
        inbox.put(sender(500, 1), 500);
        assert_eq!(inbox.next(), Some(500));
        for process in [1, 900] {
            inbox.put(sender(process, 2), process);
        }
        assert_eq!([inbox.next(), inbox.next(), inbox.next()], [Some(500), Some(1), Some(900)]);
    }
}
