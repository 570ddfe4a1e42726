//! The rate through TLS, beside the rate without it: the same clients ask the same device by two ports of one program, in turn.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::Effort;
use crate::authority::{Authority, Unusual};
use crate::common::{PATIENCE, Program, free_port};
use crate::figure::{Target, figure};
use crate::statistics::median;
use crate::tcp_device;

const CLIENTS: usize = 8;
const ROUNDS: usize = 7;
const ROUND_MS: u64 = 1_000;
/// Ten registers.
const REQUEST: [u8; 12] = [0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 10];
const RESPONSE_BYTES: usize = 7 + 2 + 20;

/// A client's connection, plain or not.
trait Link: Read + Write + Send {}
impl<T: Read + Write + Send> Link for T {}

fn plain(port: u16) -> io::Result<TcpStream> {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    Ok(stream)
}

fn secure(port: u16, config: &Arc<ClientConfig>) -> io::Result<StreamOwned<ClientConnection, TcpStream>> {
    let name = ServerName::try_from("127.0.0.1").unwrap();
    Ok(StreamOwned::new(ClientConnection::new(config.clone(), name).unwrap(), plain(port)?))
}

/// Requests per second of all clients together.
fn rate(links: &mut [Box<dyn Link>], length: Duration) -> f64 {
    let start = Instant::now();
    let ask = |link: &mut Box<dyn Link>| {
        let mut count = 0_u32;
        while start.elapsed() < length {
            let mut response = [0; RESPONSE_BYTES];
            link.write_all(&REQUEST).and_then(|()| link.flush()).unwrap();
            link.read_exact(&mut response).unwrap();
            assert_eq!(response[7], 3, "values, and no exception");
            count += 1;
        }
        count
    };
    let counts = thread::scope(|scope| {
        let clients: Vec<_> = links.iter_mut().map(|link| scope.spawn(move || ask(link))).collect();
        clients.into_iter().map(|client| client.join().unwrap()).sum::<u32>()
    });
    f64::from(counts) / start.elapsed().as_secs_f64()
}

/// Prints the figures.
pub(crate) fn figures(effort: Effort) {
    let authority = Authority::new("plant");
    authority.certify("gateway", Unusual::default());
    authority.certify("client", Unusual { roles: &["operator"], ..Unusual::default() });
    let (folder, secured) = (authority.folder().display(), free_port());
    let program = Program::configured(&format!(
        "certificate gateway own {folder}/gateway.pem key {folder}/gateway.key
         certificate plant clients {folder}/plant.pem
         port P502 tcp server 127.0.0.1:{{port}}
         port secure tcp server 127.0.0.1:{secured} tls
         port device tcp client 127.0.0.1:{} in-flight 16
         route P502 * * * device merge off
         route secure * * * device merge off role operator
",
        tcp_device::start()
    ));
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(authority.file("plant.pem")).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = config.with_root_certificates(roots).with_client_auth_cert(
        vec![CertificateDer::from_pem_file(authority.file("client.pem")).unwrap()],
        PrivateKeyDer::from_pem_file(authority.file("client.key")).unwrap(),
    );
    let config = Arc::new(config.unwrap());
    let mut by_plain: Vec<Box<dyn Link>> = Vec::new();
    let mut by_tls: Vec<Box<dyn Link>> = Vec::new();
    for _ in 0..CLIENTS {
        by_plain.push(Box::new(plain(program.port).unwrap()));
        by_tls.push(Box::new(secure(secured, &config).unwrap()));
    }
    let length = effort.length(ROUND_MS);
    // Handshakes, and whatever else happens once.
    for links in [&mut by_plain, &mut by_tls] {
        rate(links, length / 10);
    }
    let rounds: Vec<[f64; 2]> = (0..effort.rounds(ROUNDS))
        .map(|_| [rate(&mut by_plain, length), rate(&mut by_tls, length)])
        .collect();
    let of = |value: &dyn Fn(&[f64; 2]) -> f64| median(rounds.iter().map(value));
    figure("tls_rate_plain", of(&|[plain, _]| *plain), "1/s", Target::None);
    figure("tls_rate", of(&|[_, tls]| *tls), "1/s", Target::None);
    figure("tls_rate_ratio", of(&|[plain, tls]| tls / plain), "1", Target::AtLeast(0.7));
}
