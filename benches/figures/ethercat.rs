//! EtherCAT: what a cycle costs on the SPI, how long a start takes, how images fare,
//! how soon an output is read back, and how fast Ethernet is through mailboxes.

// The worlds of the tests, which need more of them.
#[allow(dead_code)]
#[path = "../../tests/ethercat/gateway/bench.rs"]
mod bench;
mod clocks;
mod ethernet;
mod gateway;
#[path = "../../tests/ethercat/gateway/matrix.rs"]
mod matrix;
mod spi;
mod sub_device;
#[path = "../../tests/ethercat/gateway/virtual_devices.rs"]
mod virtual_devices;

pub(crate) fn figures() {
    gateway::figures();
    spi::figures();
    sub_device::figures();
    clocks::figures();
    ethernet::figures();
}
