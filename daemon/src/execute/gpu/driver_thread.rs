//! A thread that works with a driver, and stays for the next time.
//!
//! A thread that has used NVIDIA's driver (580.159.04) must not end while another one destroys a device: each
//! then waits for a lock of the driver that the other holds, and whoever asks the driver next waits with them.
//! So what is done with a driver now and then is done by one thread, which ends with whatever it works for.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// A thread that does one work whenever it is asked.
pub struct DriverThread<T> {
    /// `None` once the thread is to end.
    ask: Option<SyncSender<()>>,
    done: Receiver<T>,
    thread: Option<JoinHandle<()>>,
}

/// What has come of the work.
#[derive(Debug)]
pub enum Progress<T> {
    /// It is under way.
    UnderWay,
    /// It is done.
    Done(T),
    /// It panicked, and the thread has ended.
    Panicked,
}

impl<T: Send + 'static> DriverThread<T> {
    /// A thread that begins with its work at once.
    ///
    /// # Errors
    /// The system starts no thread.
    pub fn start(name: &str, mut work: impl FnMut() -> T + Send + 'static) -> io::Result<Self> {
        let (ask, asked) = sync_channel(1);
        let (tell, done) = sync_channel(1);
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            // Dropped last: who is told of a panic asks in vain.
            let tell = tell;
            let asked = asked;
            loop {
                if tell.send(work()).is_err() || asked.recv().is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { ask: Some(ask), done, thread: Some(thread) })
    }

    /// Asks for the work once more, after it was [done](Self::progress). `false` where the thread has ended.
    pub fn ask(&self) -> bool {
        self.ask.as_ref().is_some_and(|ask| ask.try_send(()).is_ok())
    }

    /// What has come of the work since it was asked for; told once.
    pub fn progress(&self) -> Progress<T> {
        match self.done.try_recv() {
            Ok(done) => Progress::Done(done),
            Err(TryRecvError::Empty) => Progress::UnderWay,
            Err(TryRecvError::Disconnected) => Progress::Panicked,
        }
    }
}

impl<T> Drop for DriverThread<T> {
    /// Waits for the end of the thread, and so for work that is under way: a process that ends while a thread
    /// uses the driver would unload it under that thread.
    fn drop(&mut self) {
        self.ask = None;
        if let Some(thread) = self.thread.take() {
            // The panic message of the thread was printed already.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    fn wait<T: Send + 'static>(thread: &DriverThread<T>) -> Option<T> {
        let give_up_at = Instant::now() + Duration::from_secs(30);
        loop {
            match thread.progress() {
                Progress::Done(done) => return Some(done),
                Progress::Panicked => return None,
                Progress::UnderWay => {
                    assert!(Instant::now() < give_up_at, "the work does not end");
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        }
    }

    #[test]
    fn one_thread_does_all_of_the_work() {
        let mut count = 0;
        let work = move || {
            count += 1;
            (count, std::thread::current().id())
        };
        let thread = DriverThread::start("test", work).expect("a thread");
        let (_, first) = wait(&thread).expect("no panic");
        for expected in 2..5 {
            assert!(thread.ask());
            assert_eq!(wait(&thread), Some((expected, first)));
        }
        assert!(matches!(thread.progress(), Progress::UnderWay), "told once");
    }

    #[test]
    fn work_that_panics_is_told_and_not_asked_for_again() {
        let thread = DriverThread::<()>::start("test", || panic!("meant")).expect("a thread");
        assert_eq!(wait(&thread), None);
        assert!(!thread.ask());
    }

    #[test]
    fn dropping_it_waits_for_work_that_is_under_way() {
        let done = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        let sets = std::sync::Arc::clone(&done);
        let work = move || {
            std::thread::sleep(Duration::from_millis(50));
            sets.store(true, std::sync::atomic::Ordering::Release);
        };
        drop(DriverThread::start("test", work).expect("a thread"));
        assert!(done.load(std::sync::atomic::Ordering::Acquire));
    }
}
