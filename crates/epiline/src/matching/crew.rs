//! Threads that work on a frame together.
//!
//! A frame has many short stages, most of which wait for the one before; waking a thread costs as much as some of them take.
//! So helpers are called once per frame, and look for work without sleeping until it is done. Nothing waits for a helper
//! that has not come yet: jobs are taken by whoever is there, not dealt out beforehand.

use std::cell::UnsafeCell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// The environment variable that caps the number of threads.
const CAP: &str = "EPILINE_THREADS";

/// Threads to use: those asked for or all cores, capped by `EPILINE_THREADS`.
///
/// Fails if the variable is set to something other than a positive whole number.
pub(super) fn thread_count(asked: Option<usize>) -> Result<usize> {
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    let cap = match std::env::var(CAP) {
        Err(_) => usize::MAX,
        Ok(value) => value
            .trim()
            .parse()
            .ok()
            .filter(|&cap| cap > 0)
            .ok_or_else(|| Error::invalid(CAP, value, "must be a positive whole number, or unset"))?,
    };
    Ok(asked.unwrap_or_else(all).min(cap))
}

/// A job of several that differ by their number.
type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// The thread that leads, and those that help it.
pub(super) struct Crew {
    size: usize,
    board: Board,
}

impl Crew {
    /// Leads a crew of so many threads, this one among them.
    pub fn assemble<R>(threads: usize, lead: impl FnOnce(&Self) -> R) -> R {
        let crew = Self { size: threads, board: Board::default() };
        if threads == 1 {
            return lead(&crew);
        }
        let helpers = (threads - 1).min(rayon::current_num_threads());
        rayon::in_place_scope(|scope| {
            let _closed = OnDrop(|| crew.board.close());
            (0..helpers).for_each(|_| scope.spawn(|_| crew.board.help()));
            lead(&crew)
        })
    }

    /// How many threads there may be.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Does jobs `0..count`, each once, and returns when all are done. For the lead alone, not from within a job.
    pub fn each(&self, count: usize, job: &Job<'_>) {
        if self.size == 1 || count < 2 {
            (0..count).for_each(job);
        } else {
            self.board.post(count, job);
        }
    }

    /// The same for jobs that differ by more than a number.
    pub fn run_all<J: FnOnce() + Send>(&self, jobs: impl Iterator<Item = J>) {
        if self.size == 1 {
            jobs.for_each(|job| job());
            return;
        }
        let jobs: Vec<_> = jobs.map(|job| Mutex::new(Some(job))).collect();
        self.each(jobs.len(), &|i| {
            let job = jobs[i].lock().ok().and_then(|mut job| job.take());
            job.into_iter().for_each(|job| job());
        });
    }
}

/// How often to look for an answer that is underway before letting others have the core.
const SPINS: u32 = 200;

/// Waits a moment, the `turns`-th in a row.
pub(super) fn pause(turns: &mut u32) {
    *turns = turns.saturating_add(1);
    if *turns < SPINS {
        std::hint::spin_loop();
    } else {
        std::thread::yield_now();
    }
}

/// Does something however a scope is left.
struct OnDrop<F: Fn()>(F);

impl<F: Fn()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// The jobs to be done at the time.
#[derive(Clone, Copy)]
struct Task {
    job: *const Job<'static>,
    count: usize,
}

/// Where the lead posts jobs and everyone takes them.
#[derive(Default)]
struct Board {
    /// How many jobs nobody has taken, in the lower half; in the upper half the number of the task, so that the jobs of
    /// two are not mistaken for each other.
    open: AtomicU64,
    /// How many are not done.
    unfinished: AtomicUsize,
    /// Written by the lead while none is unfinished, read by those who took a job of it and have not finished that.
    task: UnsafeCell<Option<Task>>,
    closed: AtomicBool,
    /// Helpers that are here.
    present: AtomicUsize,
}

// SAFETY: `task` alone is not `Sync`; see there. A job may be called on any thread.
unsafe impl Sync for Board {}

impl Board {
    /// Posts jobs, takes part, and waits until all are done.
    fn post(&self, count: usize, job: &Job<'_>) {
        assert!(self.unfinished.load(Ordering::Acquire) == 0, "jobs have no jobs of their own");
        let job: *const Job<'_> = job;
        // SAFETY: only the lifetime changes; before it ends, nobody is left who could call the job.
        let job = unsafe { std::mem::transmute::<*const Job<'_>, *const Job<'static>>(job) };
        // SAFETY: none is unfinished, so nobody reads it.
        unsafe { *self.task.get() = Some(Task { job, count }) };
        self.unfinished.store(count, Ordering::Relaxed);
        let number = (self.open.load(Ordering::Relaxed) >> 32) + 1;
        self.open.store(number << 32 | count as u64, Ordering::Release);
        // Also if a job panics.
        let _done = OnDrop(|| {
            while self.take().is_some() {
                self.finish();
            }
            let mut turns = 0;
            while self.unfinished.load(Ordering::Acquire) != 0 {
                pause(&mut turns);
            }
        });
        while self.do_one() {}
    }

    /// Lets the helpers go, and sees them off: to be woken because they were a moment late takes much longer.
    fn close(&self) {
        self.closed.store(true, Ordering::Release);
        let mut turns = 0;
        while self.present.load(Ordering::Acquire) != 0 {
            pause(&mut turns);
        }
        (0..SPINS).for_each(|_| std::hint::spin_loop());
    }

    /// Does what there is until the board is closed.
    fn help(&self) {
        self.present.fetch_add(1, Ordering::AcqRel);
        let _gone = OnDrop(|| _ = self.present.fetch_sub(1, Ordering::AcqRel));
        let mut turns = 0;
        while !self.closed.load(Ordering::Acquire) {
            if self.do_one() {
                turns = 0;
            } else {
                pause(&mut turns);
            }
        }
    }

    /// Does a job, if there is one.
    fn do_one(&self) -> bool {
        let Some(left) = self.take() else { return false };
        let _finished = OnDrop(|| self.finish());
        // SAFETY: a job was taken and is not finished.
        if let Some(Task { job, count }) = unsafe { *self.task.get() } {
            // SAFETY: so too; whoever posted it waits until it is.
            unsafe { (*job)(count - left) };
        }
        true
    }

    /// Takes a job: how many were left with it.
    fn take(&self) -> Option<usize> {
        let mut open = self.open.load(Ordering::Acquire);
        loop {
            let left = open as u32;
            if left == 0 {
                return None;
            }
            match self.open.compare_exchange_weak(open, open - 1, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => return Some(left as usize),
                Err(now) => open = now,
            }
        }
    }

    fn finish(&self) {
        self.unfinished.fetch_sub(1, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_job_is_done_once_by_any_number_of_threads() {
        for threads in [1, 2, 3, 8] {
            let done: Vec<AtomicUsize> = (0..100).map(|_| AtomicUsize::new(0)).collect();
            let rounds = Crew::assemble(threads, |crew| {
                for round in 0..500 {
                    let count = round % 5;
                    crew.each(count, &|i| {
                        done[i].fetch_add(1, Ordering::Relaxed);
                    });
                    // Jobs borrow what the lead changes afterwards.
                    let mut sum = [0; 7];
                    crew.run_all(sum.iter_mut().map(|sum| move || *sum += round));
                    assert_eq!(sum, [round; 7]);
                }
                500
            });
            let expected = |i: usize| (0..rounds).filter(|round| i < round % 5).count();
            let done = done.iter().map(|count| count.load(Ordering::Relaxed));
            assert!(done.enumerate().all(|(i, count)| count == expected(i)), "{threads} threads");
        }
    }

    #[test]
    fn a_panic_is_passed_on_and_leaves_no_one_behind() {
        for culprit in [0, 3] {
            let crashed = std::panic::catch_unwind(|| {
                Crew::assemble(3, |crew| crew.each(4, &|i| assert!(i != culprit, "job {i}")));
            });
            assert!(crashed.is_err());
        }
        Crew::assemble(3, |crew| crew.each(4, &|_| ()));
    }
}
