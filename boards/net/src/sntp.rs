//! The time of day, asked from an NTP server (SNTP, RFC 4330).

use core::convert::Infallible;
use core::net::{IpAddr, SocketAddr};

use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_net::Stack;
use embassy_net::udp::{PacketMetadata, UdpSocket};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use mobgate::gateway::Gateway;
use mobgate::gateway::date::Date;
use mobgate::hal::{OpenError, OpenErrorKind};
use mobgate::settings::ServerAddress;
use sntpc::{Error, NtpContext, NtpTimestampGenerator, NtpUdpSocket, get_time};

use crate::connector::address_of;

/// Pause between questions.
const PERIOD: Duration = Duration::from_secs(1_024);
/// The first pause after a failure; it doubles (RFC 4330, 10: 15 s at least).
const RETRY_FIRST: Duration = Duration::from_secs(16);
const RESPONSE_MAX: Duration = Duration::from_secs(5);
/// Bytes of a message (RFC 4330, 4).
const MESSAGE_BYTES: usize = 48;
/// What the own clock begins with, in seconds since 1970: 2026, so that a response is of this era (RFC 4330, 3).
const EPOCH: u64 = 1_767_225_600;

/// Asks the server in the settings of `gateway`, if there is one; never returns.
pub(crate) async fn run(gateway: &Gateway<'_>, stack: Stack<'static>) -> ! {
    loop {
        match gateway.settings(|settings| settings.ntp().cloned()) {
            Some(server) => _ = select(follow(gateway, stack, &server), gateway.new_ntp()).await,
            None => gateway.new_ntp().await,
        }
    }
}

async fn follow(gateway: &Gateway<'_>, stack: Stack<'static>, server: &ServerAddress) -> Infallible {
    let mut retry = RETRY_FIRST;
    loop {
        join(stack.wait_link_up(), stack.wait_config_up()).await;
        let told = with_timeout(RESPONSE_MAX, ask(stack, server)).await;
        let told = told.unwrap_or(Err(OpenError::new(OpenErrorKind::TimedOut, "")));
        let pause = if told.is_ok() { PERIOD } else { retry };
        retry = if told.is_ok() { RETRY_FIRST } else { (retry * 2).min(PERIOD) };
        gateway.set_time(server, told);
        Timer::after(pause).await;
    }
}

/// A date, and the time at which it was that.
async fn ask(stack: Stack<'static>, server: &ServerAddress) -> Result<(Date, Instant), OpenError> {
    let to = SocketAddr::new(IpAddr::V4(address_of(stack, server).await?), server.port);
    let (mut received, mut sent) = ([PacketMetadata::EMPTY; 1], [PacketMetadata::EMPTY; 1]);
    let (mut response, mut question) = ([0; MESSAGE_BYTES], [0; MESSAGE_BYTES]);
    let mut socket = UdpSocket::new(stack, &mut received, &mut response, &mut sent, &mut question);
    let failed = |hint| OpenError::new(OpenErrorKind::Failed, hint);
    socket.bind(0).map_err(|_| failed(""))?;
    let told = get_time(to, &Socket(socket), NtpContext::new(Uptime(Instant::MIN))).await;
    let offset = told.map(|told| told.offset()).map_err(|error| match error {
        Error::KissOfDeath(_) => OpenError::new(OpenErrorKind::Refused, "the server wants fewer questions"),
        Error::UnsynchronizedClock => failed("the server does not know the time"),
        _ => failed("that was no response of an NTP server"),
    })?;
    let now = Instant::now();
    let own = EPOCH * 1_000_000 + now.as_micros();
    Ok((Date(own.saturating_add_signed(offset)), now))
}

/// The own clock.
#[derive(Clone, Copy)]
struct Uptime(Instant);

impl NtpTimestampGenerator for Uptime {
    fn init(&mut self) {
        self.0 = Instant::now();
    }

    fn timestamp_sec(&self) -> u64 {
        EPOCH + self.0.as_secs()
    }

    fn timestamp_subsec_micros(&self) -> u32 {
        (self.0.as_micros() % 1_000_000) as u32
    }
}

/// Not sntpc's own adapter for embassy-net, which turns on its layer for networks without Ethernet.
struct Socket<'a>(UdpSocket<'a>);

impl NtpUdpSocket for Socket<'_> {
    async fn send_to(&self, bytes: &[u8], to: SocketAddr) -> sntpc::Result<usize> {
        // As `address_of` has found it.
        let SocketAddr::V4(to) = to else { return Err(Error::AddressResolve) };
        let sent = self.0.send_to(bytes, (*to.ip(), to.port())).await;
        sent.map(|()| bytes.len()).map_err(|_| Error::Network)
    }

    async fn recv_from(&self, into: &mut [u8]) -> sntpc::Result<(usize, SocketAddr)> {
        let received = self.0.recv_from(into).await;
        received
            .map(|(length, from)| (length, crate::tcp::address(from.endpoint)))
            .map_err(|_| Error::Network)
    }
}
