//! The gateway on QEMU's mps2-an386: hardware, gateway, tasks.
#![no_std]
#![no_main]
// The types of the web interface's futures are deep.
#![recursion_limit = "256"]

mod board;
mod clock;
#[cfg(feature = "ethercat")] // Images without this, `ssh` or `web` are smaller, see Cargo.toml.
mod ethercat;
mod ethernet;
mod executor;
mod faults;
mod flash;
mod gateway;
mod interrupts;
mod lines;
mod measure;
mod names;
mod network;
mod register;
mod ring;
mod semihosting;
#[cfg(feature = "ssh")]
mod ssh;
mod transmitter;
mod uart;
mod vectors;
#[cfg(feature = "web")]
mod web;

use mobgate::settings::PortId;
use mobgate_net::{Connector, Datagrams, Sockets, TcpSockets};
use static_cell::StaticCell;

use crate::board::{Board, Store};
use crate::gateway::{CONNECTIONS, GATEWAY, PORTS};
use crate::lines::{FIGURES, Lines};
use crate::uart::{DIVISOR_MIN, Line};

#[embassy_executor::task]
async fn router() -> ! {
    GATEWAY.route().await
}

#[embassy_executor::task(pool_size = PORTS)]
async fn port(id: PortId, sockets: &'static Sockets) -> ! {
    match GATEWAY.run_port(id, &mut Lines, &Connector::new(sockets), &mut Datagrams::new(sockets)).await {}
}

#[embassy_executor::task(pool_size = CONNECTIONS)]
async fn connection(index: usize, sockets: &'static Sockets) -> ! {
    match GATEWAY.run_connection(index, &mut TcpSockets::new(sockets)).await {}
}

#[embassy_executor::task]
async fn console(store: Store, board: &'static Board) {
    board::console(&GATEWAY, store, board).await
}

#[embassy_executor::task]
async fn figures(sockets: &'static Sockets) {
    measure::report(Line::open(FIGURES, DIVISOR_MIN), sockets).await
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let core = cortex_m::Peripherals::take().unwrap();
    semihosting::start_log();
    clock::start();
    measure::start(core.SYST);
    uart::start();
    let store = board::load(&GATEWAY);
    let (sockets, runner) = GATEWAY.settings(|settings| network::start(&settings.own_network()));
    static BOARD: StaticCell<Board> = StaticCell::new();
    let board: &Board = BOARD.init(Board::new(sockets));
    executor::run(|spawner| {
        // Each pool has room for the tasks spawned here, and this runs once.
        spawner.spawn(router().unwrap());
        (0..PORTS).for_each(|index| spawner.spawn(port(PortId(index as u8), sockets).unwrap()));
        (0..CONNECTIONS).for_each(|index| spawner.spawn(connection(index, sockets).unwrap()));
        network::spawn(spawner, runner, sockets);
        #[cfg(feature = "ssh")]
        ssh::start(spawner, sockets, store.another(), board);
        #[cfg(feature = "web")]
        web::start(spawner, sockets, &store, board);
        spawner.spawn(console(store, board).unwrap());
        #[cfg(feature = "ethercat")]
        ethercat::start(spawner);
        spawner.spawn(figures(sockets).unwrap());
    })
}

/// The linker's memory maps: a change must relink the image.
const _: (&[u8], &[u8]) = (include_bytes!("../../../memory.x"), include_bytes!("../regions.x"));
