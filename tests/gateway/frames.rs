//! The frame pool and the channels.

use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use mobgate::frame::{Channel, Fill, Frame, FramePool, Slot};

use crate::prelude::*;

/// A pool of so many frames, of which `owners` have one each for themselves.
fn pool(frames: usize, owners: usize) -> FramePool<'static> {
    FramePool::new((0..frames).map(|_| Slot::new()).collect::<Vec<_>>().leak(), owners)
}

fn filled<'p>(pool: &'p FramePool<'p>, owner: usize, pdu: &[u8]) -> Option<Frame<'p>> {
    let (mut writer, frame) = pool.take(owner)?;
    writer.push(pdu).unwrap();
    writer.finish();
    Some(frame)
}

fn pdu(frame: &Frame<'_>) -> Vec<u8> {
    frame.pdu(<[u8]>::to_vec)
}

#[test]
fn an_owner_has_its_reserved_frame_however_many_the_others_hold() {
    let pool = pool(5, 2);
    let flood: Vec<_> = std::iter::from_fn(|| filled(&pool, 0, &[3])).collect();
    assert_eq!(flood.len(), 4, "its own and the three shared ones");
    let own = filled(&pool, 1, &[4]).expect("the reserved frame of the other owner");
    assert_eq!(pdu(&own), [4]);
    assert!(filled(&pool, 1, &[4]).is_none());
    drop((flood, own));
    assert_eq!(pool.free(), 5);
}

#[test]
fn a_frame_is_free_when_its_last_handle_is_dropped() {
    let pool = pool(1, 0);
    let frame = filled(&pool, 0, &[1]).unwrap();
    let other = frame.share();
    drop(frame);
    assert!(pool.take(0).is_none());
    assert_eq!(pdu(&other), [1]);
    drop(other);
    assert!(pool.take(0).is_some());
}

#[test]
fn frames_that_ride_on_another_are_taken_down_one_by_one_or_freed_with_it() {
    let pool = pool(4, 0);
    let carrier = filled(&pool, 0, &[3]).unwrap();
    assert!(carrier.take_merged().is_none());
    for merged in [[3, 3], [3, 2], [3, 1]] {
        carrier.merge(filled(&pool, 0, &merged).unwrap());
    }
    assert_eq!(pool.free(), 0);
    assert_eq!(carrier.take_merged().map(|merged| pdu(&merged)), Some(vec![3, 1]));
    assert_eq!(pool.free(), 1, "it was dropped");
    assert_eq!(carrier.take_merged().map(|merged| pdu(&merged)), Some(vec![3, 2]));
    let other = carrier.share();
    drop(carrier);
    assert_eq!(pool.free(), 2, "somebody still holds the one that carries");
    drop(other);
    assert_eq!(pool.free(), 4);
}

#[test]
fn only_complete_frames_have_the_same_pdu() {
    let pool = pool(3, 0);
    let frame = filled(&pool, 0, &[3, 0]).unwrap();
    assert!(frame.same_pdu(&filled(&pool, 0, &[3, 0]).unwrap()));
    assert!(!frame.same_pdu(&filled(&pool, 0, &[3, 0, 1]).unwrap()));
    let (mut writer, other) = pool.take(0).unwrap();
    writer.push(&[3, 0]).unwrap();
    assert!(!frame.same_pdu(&other), "more may come");
    writer.finish();
    assert!(frame.same_pdu(&other));
}

#[test]
fn an_unfinished_writer_leaves_the_frame_broken() {
    let pool = pool(1, 0);
    let (mut writer, frame) = pool.take(0).unwrap();
    writer.push(&[3, 0]).unwrap();
    assert_eq!(frame.filled(), (2, Fill::Filling));
    drop(writer);
    assert_eq!(frame.filled(), (2, Fill::Broken));
}

#[test]
fn a_pdu_that_is_too_long_is_refused_whole() {
    let pool = pool(1, 0);
    let (mut writer, frame) = pool.take(0).unwrap();
    writer.push(&[7; 250]).unwrap();
    assert!(writer.push(&[7; 4]).is_err());
    assert_eq!(frame.filled().0, 250);
    writer.push(&[7; 3]).unwrap();
    assert_eq!(frame.filled().0, 253);
}

struct Wakes(AtomicUsize);

impl Wake for Wakes {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn a_reader_follows_a_frame_that_is_still_being_filled() {
    let pool = pool(1, 0);
    let (mut writer, frame) = pool.take(0).unwrap();
    let wakes = Arc::new(Wakes(AtomicUsize::new(0)));
    let waker = Waker::from(wakes.clone());
    let mut cx = Context::from_waker(&waker);
    let mut more = pin!(frame.more_than(1));
    assert!(more.as_mut().poll(&mut cx).is_pending());
    writer.push(&[3]).unwrap();
    assert!(more.as_mut().poll(&mut cx).is_pending(), "one byte is not more than one");
    writer.push(&[0, 1]).unwrap();
    assert!(wakes.0.load(Ordering::Relaxed) >= 2);
    assert_eq!(more.as_mut().poll(&mut cx), Poll::Ready((3, Fill::Filling)));
    let mut end = pin!(frame.more_than(3));
    assert!(end.as_mut().poll(&mut cx).is_pending());
    writer.finish();
    assert_eq!(end.as_mut().poll(&mut cx), Poll::Ready((3, Fill::Complete)));
}

#[test]
fn a_response_takes_the_place_of_its_request() {
    let pool = pool(1, 0);
    let frame = filled(&pool, 0, &[3, 0, 0, 0, 1]).unwrap();
    frame.replace(&[3, 2, 0xab, 0xcd]).unwrap();
    assert_eq!(pdu(&frame), [3, 2, 0xab, 0xcd]);
    assert_eq!(frame.filled().1, Fill::Complete);
}

proptest! {
    /// Two channels and a set of held frames against plain queues: order is kept, nothing is lost or doubled.
    #[test]
    fn channels_keep_order_and_lose_nothing(steps in prop::collection::vec((0_usize..4, 0_usize..2), 1..200)) {
        let pool = pool(8, 2);
        let channels = [Channel::new(), Channel::new()];
        let mut model = [std::collections::VecDeque::new(), std::collections::VecDeque::new()];
        let mut held = Vec::new();
        let mut number = 0_u8;
        for (step, which) in steps {
            match step {
                0 | 1 => match filled(&pool, which, &[number]) {
                    Some(frame) => {
                        channels[which].send(frame);
                        model[which].push_back(number);
                        number = number.wrapping_add(1);
                    }
                    None => prop_assert!(held.len() + model[0].len() + model[1].len() >= 6),
                },
                2 => {
                    let frame = channels[which].try_receive(&pool);
                    prop_assert_eq!(frame.as_ref().map(pdu), model[which].pop_front().map(|number| vec![number]));
                    held.extend(frame);
                }
                _ => drop(held.pop()),
            }
            let out = held.len() + model[0].len() + model[1].len();
            prop_assert_eq!(pool.free(), 8 - out);
        }
    }
}
