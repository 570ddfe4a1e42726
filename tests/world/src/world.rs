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

type Life<'w> = Pin<Box<dyn Future<Output = ()> + 'w>>;

/// How time passes in a world.
pub enum Clock {
    /// It leaps to the next alarm.
    Virtual,
    /// As on the wall. What is called waits until the given time, or until something from outside is to be looked after.
    Wall(Wait),
}

/// Waits.
pub type Wait = Box<dyn FnMut(Option<Instant>)>;

/// The clock of a world that runs.
enum Running {
    Virtual(VirtualClock),
    Wall(Wait),
}

/// Time, mostly virtual, and the tasks that live in it. Dropping it drops the tasks and ends the thread's virtual time.
pub struct World<'w> {
    seed: u64,
    random: Random,
    tasks: Vec<Option<Slot<'w>>>,
    newborn: Spawner<'w>,
    runnable: Arc<Mutex<Vec<usize>>>,
    activity: Activity,
    // Declared last, dropped last: tasks may look at the clock when they are dropped.
    clock: Running,
}

struct Slot<'w> {
    future: Life<'w>,
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
pub struct Spawner<'w>(Rc<RefCell<Vec<Life<'w>>>>);

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
        Self::on(Clock::Virtual, seed)
    }

    /// A world with this clock; one on the wall begins whenever it is.
    ///
    /// # Panics
    /// As [`World::new`].
    pub fn on(clock: Clock, seed: u64) -> Self {
        let clock = match clock {
            Clock::Virtual => Running::Virtual(virtual_time::enter()),
            Clock::Wall(wait) => Running::Wall(wait),
        };
        Self {
            seed,
            random: Random::new(seed),
            tasks: Vec::new(),
            newborn: Spawner::default(),
            runnable: Arc::default(),
            activity: Activity::default(),
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

    /// Tells when tasks have done something.
    pub fn activity(&self) -> Activity {
        self.activity.clone()
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
                if self.activity.wake() {
                    continue;
                }
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
        if self.newborn.0.borrow().is_empty() {
            return;
        }
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
        self.activity.0.borrow_mut().polls += 1;
        if poll_with(slot.future.as_mut(), &slot.waker).is_ready() {
            self.tasks[task] = None;
        }
    }

    fn leap(&mut self) {
        let next = mobgate_clock::next_alarm();
        match (&mut self.clock, next) {
            (Running::Virtual(clock), Some(at)) => clock.advance_to(at),
            (Running::Virtual(_), None) => {
                panic!("nothing will ever happen again, and what was waited for has not come")
            }
            (Running::Wall(wait), next) => {
                wait(next.map(Instant::from_ticks));
                mobgate_clock::fire_due();
            }
        }
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

/// Tells when tasks have done something. Clones tell the same, to one of them at a time.
///
/// Whoever looks at something again and again, as a MainDevice does in every cycle, can leave out the looks before which
/// nothing has happened.
#[derive(Clone, Default)]
pub struct Activity(Rc<RefCell<Watch>>);

#[derive(Default)]
struct Watch {
    /// How often tasks were polled.
    polls: u64,
    /// Who waits for more polls than there were.
    waiting: Option<(u64, Waker)>,
}

impl Activity {
    /// Waits until a task has done something, and all that follows from it in the same instant is done.
    pub async fn settled(&self) {
        let mut waits = false;
        poll_fn(|context| {
            let mut watch = self.0.borrow_mut();
            let since = match &watch.waiting {
                None if waits => return Poll::Ready(()),
                Some((since, _)) if waits => *since,
                _ => watch.polls,
            };
            waits = true;
            watch.waiting = Some((since, context.waker().clone()));
            Poll::Pending
        })
        .await;
    }

    /// Wakes who waits, before time leaps; says whether there was somebody to be woken.
    fn wake(&self) -> bool {
        let mut watch = self.0.borrow_mut();
        let polls = watch.polls;
        let due = watch.waiting.take_if(|(since, _)| *since < polls);
        drop(watch);
        due.map(|(_, waker)| waker.wake()).is_some()
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
    fn whoever_waits_for_activity_comes_after_all_others_of_the_instant_and_only_then() {
        let seen = RefCell::new(Vec::new());
        let count = Cell::new(0);
        let mut world = World::new(1);
        for _ in 0..5 {
            world.spawn(async {
                for pause in [10, 0, 90] {
                    Timer::after_millis(pause).await;
                    yield_now().await;
                    count.set(count.get() + 1);
                }
            });
        }
        let activity = world.activity();
        world.run_until(async {
            // By then all of them wait for the first time, whoever was drawn first.
            Timer::after_millis(1).await;
            for _ in 0..2 {
                activity.settled().await;
                seen.borrow_mut().push((Instant::now().as_millis(), count.get()));
            }
        });
        assert_eq!(seen.into_inner(), [(10, 10), (100, 15)]);
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
