//! Six stations behind one TCP client, one of which dies: whether the others are asked as before, and whether the status words of
//! its rows are those of the source's table all the time.

use std::collections::BTreeMap;

use mobgate::scanner::RowId;

use crate::line::seconds;
use crate::prelude::*;

const STATIONS: u8 = 6;
const DEAD: u8 = 3;
const OUTAGE: Duration = Duration::from_secs(60);
const SCAN: Duration = Duration::from_millis(200);
/// No frame begins at a scan but the first one of an attempt.
const TIME_OUT: Duration = Duration::from_millis(310);
/// How often the devices are looked at, and the status words.
const LOOK: Duration = Duration::from_micros(100);
const SAMPLE: Duration = Duration::from_millis(10);
/// From an edge to the next sample: what takes no longer is not seen.
const SETTLED: Duration = Duration::from_millis(8);
/// As the table of the source says: so many frames, then no attempt for so many seconds.
const FRAMES: u32 = 3;
const IGNORED: [u64; 10] = [15, 17, 19, 21, 23, 25, 27, 29, 30, 30];

/// A row: its function, what it is, its reading priority and that as a period.
const ROWS: [(usize, &str, &str, Option<Duration>); 4] = [
    (3, "holding 0 count 8", "high", Some(SCAN)),
    (1, "coil 0 count 18", "normal", Some(Duration::from_secs(1))),
    (4, "input 0 count 8", "low", Some(Duration::from_secs(5))),
    (2, "discrete 0 count 8", "manual", None),
];

pub(crate) fn figures() {
    let (before, after) = (requests(false), requests(true));
    let living = before.iter().zip(&after).filter(|((station, _), _)| **station != DEAD);
    let shifts = living.flat_map(|((_, before), (_, after))| {
        assert!(before.len() == after.len() && before.len() > 100, "{} and {}", before.len(), after.len());
        before.iter().zip(after).map(|(before, after)| before.abs_diff(*after))
    });
    let shift = shifts.max().expect("living stations");
    figure("six_stations_shift", shift as f64 / 1e3, "ms", Target::AtMost(0.0));

    let (wrong, looked_at) = status_words();
    figure("outage_status_wrong", wrong as f64, "words", Target::AtMost(0.0));
    figure("outage_status_words", looked_at as f64, "words", Target::None);
}

fn settings() -> String {
    let stations = (1..=STATIONS).map(|unit| {
        let rows = ROWS.iter().enumerate().map(move |(nth, (_, what, priority, _))| {
            format!("point s{unit}r{nth} s{unit} {what} read {priority}\n")
        });
        format!(
            "server plc unit {unit} at 10.0.1.{unit}\ndevice s{unit} unit {unit}\n{}",
            rows.collect::<String>()
        )
    });
    format!(
        "port plc tcp client idle 0 timeout 310ms late-window 1ms
        port scan scanner
        route scan 1-{STATIONS} * * plc
        {}",
        stations.collect::<String>()
    )
}

fn with_stations<T>(scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device]) -> T) -> T {
    with_gateway(1, &settings(), |world, rig| {
        let devices: Vec<Device> = (1..=STATIONS).map(Device::new).collect();
        for (unit, device) in (1..).zip(&devices) {
            rig.attach_tcp(world, &format!("10.0.1.{unit}:502"), [device.clone()]);
        }
        // Just behind a scan at which all rows were due that ever are.
        world.run_until(Timer::at(Instant::from_micros(20_050_050)));
        scenario(world, rig, &devices)
    })
}

fn silence() -> Faults {
    Faults::new(1).with(When::Always, Fault::Dead)
}

/// When each station was asked during an outage, or without one, in microseconds, and to 100 of them.
fn requests(outage: bool) -> BTreeMap<u8, Vec<u64>> {
    with_stations(|world, _, devices| {
        if outage {
            devices[usize::from(DEAD) - 1].set_faults(silence());
        }
        let mut counts: Vec<u64> = devices.iter().map(|device| device.counters().all_requests()).collect();
        let mut seen = BTreeMap::<u8, Vec<u64>>::new();
        let end = Instant::now() + OUTAGE;
        while Instant::now() < end {
            world.run_for(LOOK);
            for (count, device) in counts.iter_mut().zip(devices) {
                let new = device.counters().all_requests() - *count;
                *count += new;
                (0..new)
                    .for_each(|_| seen.entry(device.unit()).or_default().push(Instant::now().as_micros()));
            }
        }
        seen
    })
}

/// What the source's table says of the dead station's rows, by itself.
struct Table {
    /// The row that each attempt tries, as far as attempts have begun, and the scan at which it began.
    attempts: Vec<(usize, Instant)>,
    /// The scan at which the station answered again.
    recovered: Option<Instant>,
}

/// The scan at this time or before. All rows were due at the start: each is at the scans that are multiples of its period.
fn scan(now: Instant) -> Instant {
    Instant::from_micros(now.as_micros() / SCAN.as_micros() * SCAN.as_micros())
}

/// The scans behind `from` and not behind `now` at which `row` is due.
fn times_due(row: usize, from: Instant, now: Instant) -> u64 {
    let periods = |time: Instant| ROWS[row].3.map_or(0, |period| time.as_micros() / period.as_micros());
    periods(now) - periods(from)
}

impl Table {
    /// The last attempt, how many there have been, and when it is over if nothing answers it.
    fn attempt(&self) -> (usize, Instant, Instant) {
        let (row, at) = self.attempts[self.attempts.len() - 1];
        let frames = if self.attempts.len() == 1 { FRAMES } else { 1 };
        (row, at, at + TIME_OUT * frames)
    }

    /// When requests are looked at again.
    fn ignored_until(&self) -> Instant {
        let (_, _, over) = self.attempt();
        over + Duration::from_secs(IGNORED[(self.attempts.len() - 1).min(IGNORED.len() - 1)])
    }

    /// The scan at which the next attempt is made.
    fn next_attempt(&self) -> Instant {
        scan(self.ignored_until() + SCAN)
    }

    fn word(&self, row: usize, now: Instant) -> u16 {
        const IN_PROGRESS: u16 = 1 << 0;
        const ENDED_WELL: u16 = 1 << 1;
        const TIMED_OUT: u16 = 1 << 2 | 5 << 12;
        const IGNORED: u16 = 1 << 4;
        const MARKED: u16 = 1 << 6;
        let is_polled = ROWS[row].3.is_some();
        let (tried, at, over) = self.attempt();
        let ended = if now >= over { &self.attempts[..] } else { &self.attempts[..self.attempts.len() - 1] };
        let outcome = match (is_polled, ended.iter().any(|(tried, _)| *tried == row)) {
            (false, _) => 0,
            (true, true) if self.recovered.is_none() => TIMED_OUT,
            (true, _) => ENDED_WELL,
        };
        let marked = |is_marked: bool| if is_marked { MARKED } else { 0 };
        outcome
            | match row {
                _ if self.recovered.is_some() => 0,
                _ if now >= self.ignored_until() => 0,
                _ if now >= over => IGNORED,
                // It is marked when it is due again while a frame of it is on its way, and the next frame serves a mark. (A scan that
                // finds it marked already counts.)
                row if row == tried => {
                    let repeats = (now - at).as_micros() / TIME_OUT.as_micros();
                    IN_PROGRESS | marked(times_due(row, at, now) > repeats)
                }
                // Behind the first time that requests were ignored all are due.
                row => marked(is_polled && self.attempts.len() > 1 || times_due(row, at, now) > 0),
            }
    }
}

/// The status words that are not as the table says, and all of them: every 10 ms through an outage and what comes behind it.
fn status_words() -> (u64, u64) {
    with_stations(|world, rig, devices| {
        let device = &devices[usize::from(DEAD) - 1];
        let first = usize::from(DEAD - 1) * ROWS.len();
        let status = |row: usize| {
            let id = RowId((first + row) as u8);
            rig.gateway.scanner().unwrap().change(|scanner| scanner.status(id, Instant::now())).bits()
        };
        let asked = |since: &[u64; 128]| {
            let now = device.counters().requests;
            ROWS.iter().position(|(function, ..)| now[*function] > since[*function])
        };
        device.set_faults(silence());
        let end = Instant::now() + OUTAGE;
        let mut since = device.counters().requests;
        let first_tried = loop {
            world.run_for(LOOK);
            if let Some(row) = asked(&since) {
                break row;
            }
        };
        let begin = scan(Instant::now());
        let mut table = Table { attempts: vec![(first_tried, begin)], recovered: None };
        let (mut wrong, mut words) = (0, 0);
        let mut sample = begin + SETTLED;
        while table.recovered.is_none_or(|at| sample < at + Duration::from_secs(1)) {
            world.run_until(Timer::at(sample));
            if sample >= end {
                device.set_faults(Faults::new(1));
            }
            let next = table.next_attempt();
            if table.recovered.is_none() && sample >= next {
                // Which row goes first is the gateway's choice: the device has seen it.
                match asked(&since) {
                    Some(row) if next < end => table.attempts.push((row, next)),
                    _ => table.recovered = Some(next),
                }
            }
            since = device.counters().requests;
            wrong += (0..ROWS.len()).filter(|&row| status(row) != table.word(row, sample)).count() as u64;
            words += ROWS.len() as u64;
            sample += SAMPLE;
        }
        assert!(seconds(sample - begin) > seconds(OUTAGE), "the whole outage");
        (wrong, words)
    })
}
