//! The loop that polls everything in virtual time.
//!
//! Runnable tasks are polled in an order drawn from the seed. When none is left, time leaps to the next alarm: what
//! takes ten minutes on a real line takes seconds, and a run is repeated exactly by its seed.

use std::cell::RefCell;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Wake, Waker};

use embassy_time::{Duration, Instant, Timer};
use mobgate_clock::virtual_time::{self, VirtualClock};

use crate::random::Random;

/// Polls without time advancing after which tasks are taken to wake each other forever.
const POLLS_PER_INSTANT_MAX: u32 = 1_000_000;
/// Task number of the future that `run_until` was given.
const MAIN: usize = usize::MAX;

type Running<'w> = Pin<Box<dyn Future<Output = ()> + 'w>>;

/// Virtual time and the tasks that live in it. Dropping it drops the tasks and ends the thread's virtual time.
pub struct World<'w> {
    seed: u64,
    random: Random,
    tasks: Vec<Option<Slot<'w>>>,
    newborn: Spawner<'w>,
    runnable: Arc<Mutex<Vec<usize>>>,
    // Declared last, dropped last: tasks may look at the clock when they are dropped.
    clock: VirtualClock,
}

struct Slot<'w> {
    future: Running<'w>,
    waker: Arc<TaskWaker>,
}

/// Puts its task on the list of runnable ones, once until it is polled.
struct TaskWaker {
    task: usize,
    listed: AtomicBool,
    runnable: Arc<Mutex<Vec<usize>>>,
}

impl Wake for TaskWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if !self.listed.swap(true, Ordering::Relaxed) {
            self.runnable.lock().unwrap_or_else(PoisonError::into_inner).push(self.task);
        }
    }
}

/// Starts tasks, also from within a task.
#[derive(Clone, Default)]
pub struct Spawner<'w>(Rc<RefCell<Vec<Running<'w>>>>);

impl<'w> Spawner<'w> {
    /// Starts `future`; the result awaits its end, and may be dropped without harm to the task.
    pub fn spawn<T: 'w>(&self, future: impl Future<Output = T> + 'w) -> Task<T> {
        let outcome = Rc::new(RefCell::new(Outcome { value: None, waiting: None }));
        let end = outcome.clone();
        self.0.borrow_mut().push(Box::pin(async move {
            let value = future.await;
            let waiting = {
                let mut end = end.borrow_mut();
                end.value = Some(value);
                end.waiting.take()
            };
            waiting.into_iter().for_each(Waker::wake);
        }));
        Task(outcome)
    }
}

struct Outcome<T> {
    value: Option<T>,
    waiting: Option<Waker>,
}

/// The end of a spawned task, to be awaited.
pub struct Task<T>(Rc<RefCell<Outcome<T>>>);

impl<T> Task<T> {
    /// Whether the task has ended and its value has not been taken.
    pub fn is_finished(&self) -> bool {
        self.0.borrow().value.is_some()
    }
}

impl<T> Future for Task<T> {
    type Output = T;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<T> {
        let mut outcome = self.0.borrow_mut();
        match outcome.value.take() {
            Some(value) => Poll::Ready(value),
            None => {
                outcome.waiting = Some(context.waker().clone());
                Poll::Pending
            }
        }
    }
}

impl<'w> World<'w> {
    /// A world at time 0 in which `seed` decides everything that is left to chance.
    ///
    /// # Panics
    /// When this thread has a world already.
    pub fn new(seed: u64) -> Self {
        let clock = virtual_time::enter();
        Self {
            seed,
            random: Random::new(seed),
            tasks: Vec::new(),
            newborn: Spawner::default(),
            runnable: Arc::default(),
            clock,
        }
    }

    /// The seed that repeats this run.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// A generator for the scenario's own draws, independent of the order of polling.
    pub fn random(&mut self) -> Random {
        self.random.fork()
    }

    /// Starts `future`, which runs whenever the world does.
    pub fn spawn<T: 'w>(&self, future: impl Future<Output = T> + 'w) -> Task<T> {
        self.newborn.spawn(future)
    }

    /// A handle for tasks that start others.
    pub fn spawner(&self) -> Spawner<'w> {
        self.newborn.clone()
    }

    /// Lets `duration` of virtual time pass.
    pub fn run_for(&mut self, duration: Duration) {
        self.run_until(Timer::after(duration));
    }

    /// Runs the world until `future` is done.
    ///
    /// # Panics
    /// When nothing is left that could ever wake `future`, or when tasks wake each other without end.
    pub fn run_until<T>(&mut self, future: impl Future<Output = T>) -> T {
        let mut main = pin!(future);
        let main_waker = self.waker(MAIN);
        main_waker.wake_by_ref();
        let mut polls = 0;
        loop {
            self.admit_newborn();
            let Some(task) = self.draw() else {
                self.leap();
                polls = 0;
                continue;
            };
            polls += 1;
            assert!(polls < POLLS_PER_INSTANT_MAX, "tasks wake each other without end at {}", Instant::now());
            if task != MAIN {
                self.poll_task(task);
            } else if let Poll::Ready(value) = poll_with(main.as_mut(), &main_waker) {
                return value;
            }
        }
    }

    fn waker(&self, task: usize) -> Arc<TaskWaker> {
        Arc::new(TaskWaker { task, listed: AtomicBool::new(false), runnable: self.runnable.clone() })
    }

    fn admit_newborn(&mut self) {
        for future in self.newborn.0.take() {
            let waker = self.waker(self.tasks.len());
            waker.wake_by_ref();
            self.tasks.push(Some(Slot { future, waker }));
        }
    }

    /// Takes one of the runnable tasks, whichever the seed says.
    fn draw(&mut self) -> Option<usize> {
        let mut runnable = self.runnable.lock().unwrap_or_else(PoisonError::into_inner);
        match runnable.len() {
            0 => None,
            1 => runnable.pop(),
            length => Some(runnable.swap_remove(self.random.index(length))),
        }
    }

    fn poll_task(&mut self, task: usize) {
        let Some(slot) = self.tasks.get_mut(task).and_then(Option::as_mut) else { return };
        if poll_with(slot.future.as_mut(), &slot.waker).is_ready() {
            self.tasks[task] = None;
        }
    }

    fn leap(&self) {
        let Some(at) = mobgate_clock::next_alarm() else {
            panic!("nothing will ever happen again, and what was waited for has not come");
        };
        self.clock.advance_to(at);
    }
}

fn poll_with<T>(future: Pin<&mut (impl Future<Output = T> + ?Sized)>, waker: &Arc<TaskWaker>) -> Poll<T> {
    waker.listed.store(false, Ordering::Relaxed);
    future.poll(&mut Context::from_waker(&Waker::from(waker.clone())))
}

impl Drop for World<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("this was seed {} at {} us", self.seed, Instant::now().as_micros());
        }
    }
}

/// Lets every other runnable task of this instant have a turn.
pub async fn yield_now() {
    let mut yielded = false;
    poll_fn(|context| {
        if std::mem::replace(&mut yielded, true) {
            return Poll::Ready(());
        }
        context.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use embassy_time::{Duration, Instant, Timer};

    use super::{World, yield_now};

    #[test]
    fn time_leaps_to_the_next_alarm() {
        let mut world = World::new(1);
        let hour = world.run_until(async {
            Timer::after_secs(3_600).await;
            Instant::now()
        });
        assert_eq!(hour.as_secs(), 3_600);
    }

    #[test]
    fn tasks_run_beside_the_main_future_and_can_be_awaited() {
        let mut world = World::new(1);
        let slow = world.spawn(async {
            Timer::after_millis(20).await;
            "slow"
        });
        let quick = world.spawn(async {
            Timer::after_millis(10).await;
            Instant::now().as_millis()
        });
        let (slow, quick) = world.run_until(async { (slow.await, quick.await) });
        assert_eq!((slow, quick), ("slow", 10));
    }

    #[test]
    fn tasks_may_borrow_what_was_there_before_the_world() {
        let count = Cell::new(0);
        let mut world = World::new(1);
        world.spawn(async { count.set(count.get() + 1) });
        world.run_for(Duration::from_millis(1));
        assert_eq!(count.get(), 1);
    }

    #[test]
    fn the_seed_alone_decides_the_order() {
        let run = |seed| {
            let order = RefCell::new(Vec::new());
            {
                let mut world = World::new(seed);
                for task in 0..8 {
                    world.spawn({
                        let order = &order;
                        async move {
                            yield_now().await;
                            order.borrow_mut().push(task);
                        }
                    });
                }
                world.run_for(Duration::from_millis(1));
            }
            order.into_inner()
        };
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
    }

    #[test]
    #[should_panic = "nothing will ever happen again"]
    fn waiting_for_nothing_is_an_error() {
        World::new(1).run_until(std::future::pending::<()>());
    }

    #[test]
    #[should_panic = "tasks wake each other without end"]
    fn a_livelock_is_an_error() {
        World::new(1).run_until(async {
            loop {
                yield_now().await;
            }
        });
    }
}
