//! The board's own address: set in embassy-net from the settings, and reported to `show network`.

use embassy_net::{ConfigV4, DhcpConfig, HardwareAddress, Ipv4Cidr, Stack, StaticConfigV4};
use heapless::String;
use mobgate::gateway::Gateway;
use mobgate::hal::NetworkState;
use mobgate::settings::{OwnNetwork, StaticAddress};

/// embassy-net's configuration for these settings.
pub fn stack_config(network: &OwnNetwork) -> embassy_net::Config {
    let mut config = embassy_net::Config::default();
    config.ipv4 = ipv4(network);
    config
}

/// Reconfigures `stack` whenever the settings change; never returns. Connections over the old address break.
pub async fn follow(gateway: &Gateway<'_>, stack: Stack<'static>) -> ! {
    loop {
        let network = gateway.new_network().await;
        stack.set_config_v4(ipv4(&network));
    }
}

/// The current state of the network.
pub fn state(stack: Stack<'static>) -> NetworkState {
    let address = stack.config_v4().map(|own| StaticAddress {
        address: own.address.address(),
        prefix: own.address.prefix_len(),
        gateway: own.gateway,
        dns: own.dns_servers.first().copied(),
    });
    let HardwareAddress::Ethernet(hardware) = stack.hardware_address();
    NetworkState { link: stack.is_link_up(), address, hardware: hardware.0 }
}

fn ipv4(network: &OwnNetwork) -> ConfigV4 {
    match network {
        OwnNetwork::Dhcp { name } => {
            let mut dhcp = DhcpConfig::default();
            // Both limit names to the same length.
            dhcp.hostname = name.as_str().try_into().ok().filter(|name: &String<_>| !name.is_empty());
            ConfigV4::Dhcp(dhcp)
        }
        OwnNetwork::Static(own) => ConfigV4::Static(StaticConfigV4 {
            address: Ipv4Cidr::new(own.address, own.prefix),
            gateway: own.gateway,
            dns_servers: own.dns.into_iter().collect(),
        }),
    }
}
