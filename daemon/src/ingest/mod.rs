//! Requests in hand, and whose turn it is.

use pairmask::transport::FRAMES_AT_A_TIME;

/// Requests that wait for an answer. Clients take turns; a client's own requests keep their order.
///
/// ```
/// let mut inbox = pairmaskd::ingest::Inbox::new(2);
/// for (client, request) in [(7, 'a'), (7, 'b'), (9, 'c')] {
///     inbox.put(client, request);
/// }
/// let order: Vec<char> = std::iter::from_fn(|| inbox.next()).collect();
/// assert_eq!(order, ['a', 'c', 'b']);
/// ```
#[derive(Debug)]
pub struct Inbox<R> {
    waiting: Vec<(u64, R)>,
    capacity: usize,
    last_served: u64,
}

impl<R> Inbox<R> {
    /// Room for all requests that `max_clients` may have under way.
    pub fn new(max_clients: usize) -> Self {
        let capacity = max_clients.max(1) * FRAMES_AT_A_TIME;
        Self { waiting: Vec::with_capacity(capacity), capacity, last_served: 0 }
    }

    /// Whether another request may be put in without growing.
    pub fn has_room(&self) -> bool {
        self.waiting.len() < self.capacity
    }

    /// Takes in a request of a client.
    pub fn put(&mut self, client_token: u64, request: R) {
        self.waiting.push((client_token, request));
    }

    /// The oldest request of the client whose turn it is: the next token after the last served,
    /// around the circle.
    #[allow(clippy::should_implement_trait)] // An iterator would borrow the inbox between turns.
    pub fn next(&mut self) -> Option<R> {
        let after_last = |token: u64| token.wrapping_sub(self.last_served).wrapping_sub(1);
        // `min_by_key` keeps the first of equals: the oldest of that client.
        let (turn, _) =
            self.waiting.iter().enumerate().min_by_key(|(_, (token, _))| after_last(*token))?;
        let (token, request) = self.waiting.remove(turn);
        self.last_served = token;
        Some(request)
    }
}
