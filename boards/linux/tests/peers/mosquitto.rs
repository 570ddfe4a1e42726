//! Data points at mosquitto, the broker: values, status, alarms and commands, by both versions, with a password and by TLS, and what
//! arrives while the broker is killed and started again.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, SystemTime};
use std::{env, fs};

use jiff::Timestamp;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::authority::{Authority, Unusual};
use crate::cable::{Cable, State};
use crate::common::{Program, converse, free_port, wait_for, with_console};
use crate::outside::{Running, Tool};

// Messages have the time of the wall clock.
#[allow(clippy::disallowed_methods)]
fn now() -> SystemTime {
    SystemTime::now()
}

/// What a device has served.
#[derive(Default)]
struct Registers {
    values: BTreeMap<u16, u16>,
    /// Register 7 counts its reads, unless this holds.
    holds: bool,
    /// When each value of it was served.
    served: BTreeMap<u16, SystemTime>,
    /// It does not respond.
    is_silent: bool,
    connections: usize,
    /// Requests that it has executed.
    requests: usize,
}

/// A device behind Modbus TCP with registers.
#[derive(Clone)]
pub(crate) struct Device {
    registers: Arc<Mutex<Registers>>,
    pub(crate) port: u16,
}

impl Device {
    pub(crate) fn start() -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let device = Self { registers: Arc::default(), port: listener.local_addr().unwrap().port() };
        let own = device.clone();
        thread::spawn(move || {
            for stream in listener.incoming() {
                let own = own.clone();
                thread::spawn(move || own.serve(stream.unwrap()));
            }
        });
        device
    }

    fn serve(&self, mut stream: TcpStream) {
        stream.set_nodelay(true).unwrap();
        self.registers.lock().unwrap().connections += 1;
        let mut head = [0; 7];
        while stream.read_exact(&mut head).is_ok() {
            let mut pdu = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]])) - 1];
            stream.read_exact(&mut pdu).unwrap();
            let Some(response) = self.respond(&pdu) else { continue };
            let length = (response.len() as u16 + 1).to_be_bytes();
            let head = [head[0], head[1], 0, 0, length[0], length[1], head[6]];
            if stream.write_all(&[&head[..], &response].concat()).is_err() {
                return;
            }
        }
    }

    fn respond(&self, pdu: &[u8]) -> Option<Vec<u8>> {
        let mut registers = self.registers.lock().unwrap();
        if registers.is_silent {
            return None;
        }
        registers.requests += 1;
        let (first, second) = (u16::from_be_bytes([pdu[1], pdu[2]]), u16::from_be_bytes([pdu[3], pdu[4]]));
        match pdu[0] {
            3 | 4 => {
                let mut response = vec![pdu[0], 2 * second as u8];
                for register in first..first + second {
                    if register == 7 && !registers.holds {
                        *registers.values.entry(7).or_default() += 1;
                    }
                    let value = registers.values.get(&register).copied().unwrap_or(0);
                    if register == 7 {
                        registers.served.entry(value).or_insert_with(now);
                    }
                    response.extend(value.to_be_bytes());
                }
                Some(response)
            }
            6 => {
                registers.values.insert(first, second);
                Some(pdu.to_vec())
            }
            _ => Some(vec![pdu[0] | 0x80, 1]),
        }
    }

    /// Connections and requests that have come.
    pub(crate) fn served(&self) -> (usize, usize) {
        let registers = self.registers.lock().unwrap();
        (registers.connections, registers.requests)
    }

    pub(crate) fn set(&self, register: u16, value: u16) {
        self.registers.lock().unwrap().values.insert(register, value);
    }

    /// It does not respond any more.
    pub(crate) fn fall_silent(&self) {
        self.registers.lock().unwrap().is_silent = true;
    }

    pub(crate) fn get(&self, register: u16) -> u16 {
        self.registers.lock().unwrap().values.get(&register).copied().unwrap_or(0)
    }
}

/// The broker, in a folder of its own.
pub(crate) struct Broker {
    folder: tempfile::TempDir,
    pub(crate) port: u16,
    running: Option<Running>,
}

impl Broker {
    /// Starts with these lines in its configuration, besides those of the listener.
    pub(crate) fn start(lines: &str) -> Self {
        let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
        let path = folder.path().display();
        let text = format!(
            "user root\nlistener {port} 127.0.0.1\npersistence true\npersistence_location {path}/\n\
             autosave_interval 1\nautosave_on_changes true\nmax_queued_messages 0\n{}",
            lines.replace("{folder}", &path.to_string())
        );
        fs::write(folder.path().join("mosquitto.conf"), text).unwrap();
        fs::write(folder.path().join("users"), "").unwrap();
        let mut broker = Self { folder, port, running: None };
        broker.run();
        broker
    }

    /// One that lets `gateway` in by a password.
    pub(crate) fn with_password(lines: &str) -> Self {
        let mut broker = Self::start(&format!("password_file {{folder}}/users\n{lines}"));
        broker.kill();
        let users = broker.file("users");
        let words = ["-b", "-c", users.to_str().unwrap(), "gateway", "let me in"];
        let (good, said) = Tool::mosquitto_client("mosquitto_passwd").run(&words);
        assert!(good, "{said}");
        broker.run();
        broker
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&mut self) {
        let configuration = self.file("mosquitto.conf");
        self.running = Some(Tool::mosquitto().start(["-c".into(), configuration.into()]));
        wait_for("mosquitto", || TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).ok().map(drop));
    }

    /// Ends it at once, as the kernel would for lack of memory.
    fn kill(&mut self) {
        self.running = None;
    }

    /// Has it write what it keeps, sessions as well.
    fn save(&self) {
        let child = &self.running.as_ref().unwrap().0;
        kill_process(Pid::from_child(child), Signal::USR1).unwrap();
        wait_for("the broker's file", || self.file("mosquitto.db").exists().then_some(()));
        thread::sleep(Duration::from_millis(300));
    }
}

/// A message.
#[derive(Clone)]
pub(crate) struct Heard {
    topic: String,
    pub(crate) text: String,
    retained: bool,
}

/// All that a client of others hears.
pub(crate) struct Listener {
    _running: Running,
    heard: Arc<Mutex<Vec<Heard>>>,
}

impl Listener {
    pub(crate) fn start(port: u16, more: &[&str]) -> Self {
        let port = port.to_string();
        let words = ["-h", "127.0.0.1", "-p", &port, "-v", "-t", "#", "-q", "1", "-F", "%r %t %p"];
        let words = words.iter().chain(more).map(|word| (*word).into());
        let mut running = Tool::mosquitto_client("mosquitto_sub").start(words);
        let heard = Arc::<Mutex<Vec<Heard>>>::default();
        let (into, from) = (heard.clone(), running.0.stdout.take().unwrap());
        thread::spawn(move || {
            for line in BufReader::new(from).lines().map_while(Result::ok) {
                let mut parts = line.splitn(3, ' ').map(str::to_owned);
                let mut next = || parts.next().unwrap_or_default();
                let (retained, topic, text) = (next() == "1", next(), next());
                into.lock().unwrap().push(Heard { topic, text, retained });
            }
        });
        Self { _running: running, heard }
    }

    fn all(&self, topic: &str) -> Vec<Heard> {
        self.heard.lock().unwrap().iter().filter(|heard| heard.topic == topic).cloned().collect()
    }

    /// Waits for a message on `topic` that `fits`.
    pub(crate) fn wait(&self, topic: &str, fits: impl Fn(&str) -> bool) -> Heard {
        wait_for(&format!("a message on {topic}"), || {
            self.all(topic).into_iter().find(|heard| fits(&heard.text))
        })
    }
}

pub(crate) fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn say(port: u16, more: &[&str]) {
    let port = port.to_string();
    let words = [&["-h", "127.0.0.1", "-p", &port, "-q", "1"], more].concat();
    let (good, said) = Tool::mosquitto_client("mosquitto_pub").run(&words);
    assert!(good, "{said}");
}

/// A gateway with points of `device`, and `line`.
pub(crate) fn gateway(device: &Device, line: &str) -> Program {
    with_console(&format!(
        "mdns off
port plant tcp client 127.0.0.1:{} timeout 300ms down-after 2
port P502 tcp server 127.0.0.1:{{port}}
port scan scanner
route scan * * * plant
device meter unit 1
point count meter holding 7 read 100ms
point limit meter holding 3 read 200ms write change
point level meter input 4 count 2 as i16 read 200ms
point own local holding 0 as f32
{line}
",
        device.port
    ))
}

#[test]
fn values_status_alarms_and_commands_pass_mosquitto_by_both_versions() {
    for version in ["5", "3.1.1"] {
        let broker = Broker::with_password("");
        let (device, port) = (Device::start(), broker.port);
        let who = ["-u", "gateway", "-P", "let me in"];
        device.set(4, 0xffff);
        device.set(5, 12);
        let line = |password: &str| {
            format!(
                "publish plant mqtt broker 127.0.0.1:{port} version {version} user gateway password \"{password}\" \
                 topic site/a format homeassistant commands on"
            )
        };
        // A command of before, which is not to be carried out.
        let words = [&who[..], &["-t", "site/a/points/limit/set", "-m", "9", "-r"]].concat();
        say(port, &words);
        let program = gateway(&device, &line("wrong"));
        program.logs("publisher plant: permission denied (the broker does not accept user name or password)");
        let mut session = program.session();
        converse(&mut session, &format!("{}\nshow config\n", line("let me in")), "publish plant mqtt");
        let listener = Listener::start(port, &who);
        listener.wait("site/a/plant/status", |text| text == "online");
        let level = json(&listener.wait("site/a/points/level", |text| text.contains("[-1,12]")).text);
        assert_eq!(level["quality"], "good");
        let time: Timestamp = level["time"].as_str().unwrap().parse().unwrap();
        assert!(Timestamp::now().duration_since(time).as_secs() < 10, "{level}");
        assert_eq!(device.get(3), 0, "a retained command is of before");
        // A late listener gets what was retained.
        let late = Listener::start(port, &who);
        assert!(late.wait("site/a/plant/status", |text| text == "online").retained);
        let config = json(&late.wait("homeassistant/number/site_a/limit/config", |_| true).text);
        assert_eq!(config["command_topic"], "site/a/points/limit/set");
        assert_eq!(config["unique_id"], "site_a_limit");
        assert_eq!(
            json(&late.wait("homeassistant/sensor/site_a/level_1/config", |_| true).text)["name"],
            "level 1"
        );
        commands(&device, &listener, port, &who);
        silence(&device, &listener);
        // Secrets are for the local console's own command.
        let said = converse(
            &mut session,
            "show config\nshow publishers\nshow audit\nshow config secrets\n",
            "\"let me in\"",
        );
        assert_eq!(said.matches("let me in").count(), 1, "{said}");
        assert!(said.contains(" open"), "{said}");
        drop(program);
        listener.wait("site/a/plant/status", |text| text == "offline");
    }
}

fn commands(device: &Device, listener: &Listener, port: u16, who: &[&str]) {
    let command = |point: &str, text: &str| {
        let topic = format!("site/a/points/{point}/set");
        say(port, &[who, &["-t", &topic, "-m", text]].concat());
    };
    command("limit", "1234");
    assert_eq!(listener.wait("site/a/points/limit/result", |_| true).text, r#"{"result":"written"}"#);
    assert_eq!(device.get(3), 1234);
    listener.wait("site/a/points/limit", |text| text.contains("\"value\":1234,\"quality\":\"good\""));
    command("own", "-2.5");
    listener.wait("site/a/points/own", |text| text.contains("\"value\":-2.5,"));
    for (point, text, error) in [
        ("level", "3", "it cannot be written"),
        ("limit", "70000", "a value of the point's type"),
        ("limit", "", "expected values"),
        ("nobody", "1", "no point of this name"),
    ] {
        command(point, text);
        let result = format!("site/a/points/{point}/result");
        let heard = listener.wait(&result, |text| text.contains(error));
        assert_eq!(json(&heard.text)["result"], "refused");
    }
    assert_eq!(device.get(3), 1234);
}

/// A device that does not respond makes its values stale, with the time at which they were read.
fn silence(device: &Device, listener: &Listener) {
    device.fall_silent();
    let stale = listener.wait("site/a/points/level", |text| text.contains("stale"));
    let good = listener.all("site/a/points/level");
    let good = good.iter().rfind(|heard| heard.text.contains("good")).unwrap();
    let [stale_time, good_time]: [Timestamp; 2] =
        [&stale, good].map(|heard| json(&heard.text)["time"].as_str().unwrap().parse().unwrap());
    assert!(stale_time.duration_since(good_time).as_secs() < 3, "{} {}", stale.text, good.text);
    listener.wait("site/a/alarms", |text| text.contains("down"));
    device.registers.lock().unwrap().is_silent = false;
    listener.wait("site/a/alarms", |text| !text.contains("down"));
}

#[test]
fn a_broker_by_tls_must_have_a_certificate_of_the_settings() {
    let (ours, others) = (Authority::new("plant"), Authority::new("others"));
    ours.certify("broker", Unusual::default());
    let folder = ours.folder().display();
    let broker =
        Broker::with_password(&format!("certfile {folder}/broker.pem\nkeyfile {folder}/broker.key\n"));
    let (device, port) = (Device::start(), broker.port);
    let lines = |authority: &Authority, name: &str| {
        format!(
            "certificate them servers {}/{name}.pem\npublish plant mqtt broker 127.0.0.1:{port} tls trust them \
             user gateway password \"let me in\"",
            authority.folder().display()
        )
    };
    let program = gateway(&device, &lines(&others, "others"));
    program.logs("publisher plant: failed");
    let mut session = program.session();
    converse(&mut session, &format!("{}\nshow publishers\n", lines(&ours, "plant")), "STATUS");
    let file = ours.file("plant.pem");
    let who = ["-u", "gateway", "-P", "let me in", "--cafile", file.to_str().unwrap()];
    let listener = Listener::start(port, &who);
    listener.wait("mobgate/plant/status", |text| text == "online");
    listener.wait("mobgate/points/count", |text| text.contains("good"));
    converse(&mut session, "delete certificate them\n", "publisher plant needs it");
}

/// What a gateway has published of a counter that changes at each read, while its broker had faults.
struct Load {
    broker: Broker,
    device: Device,
    listener: Listener,
    program: Program,
}

/// What should not be: values that are neither heard nor counted, heard as two, or of another time than they say.
#[derive(Debug, PartialEq, Eq)]
struct Figures {
    lost: usize,
    doubled: usize,
    stale: usize,
}

impl Load {
    /// Through `cable` if there is one.
    fn start(cable: Option<&Cable>) -> Self {
        let broker = Broker::start("allow_anonymous true\n");
        let device = Device::start();
        let listener = Listener::start(broker.port, &["-c", "-i", "listener"]);
        thread::sleep(Duration::from_millis(500));
        broker.save();
        let port = cable.map_or(broker.port, |cable| cable.port);
        if let Some(cable) = cable {
            cable.lead_to(broker.port);
        }
        let program = gateway(&device, &format!("publish plant mqtt broker 127.0.0.1:{port} every 24h"));
        listener.wait("mobgate/points/count", |text| text.contains("good"));
        Self { broker, device, listener, program }
    }

    /// Waits until what is read now has come.
    fn recover(&self) {
        let now = self.device.get(7);
        self.listener.wait("mobgate/points/count", |text| json(text)["value"].as_u64() > Some(now.into()));
    }

    fn figures(self) -> Figures {
        self.device.registers.lock().unwrap().holds = true;
        let last = self.device.get(7);
        self.listener.wait("mobgate/points/count", |text| json(text)["value"] == last);
        let said = converse(&mut self.program.session(), "show publishers\n", " open");
        let row = said.lines().find(|line| line.starts_with("plant")).unwrap();
        let counted: usize = row.split_whitespace().nth(5).unwrap().parse().unwrap();
        let served = self.device.registers.lock().unwrap().served.clone();
        let mut heard = BTreeMap::<u16, Vec<String>>::new();
        for message in self.listener.all("mobgate/points/count") {
            let value = json(&message.text);
            if let Some(number) = value["value"].as_u64().filter(|_| value["quality"] == "good") {
                // A message that comes again as it was is told from another by its time.
                let texts = heard.entry(number as u16).or_default();
                if !texts.contains(&message.text) {
                    texts.push(message.text);
                }
            }
        }
        println!("{} values served, {} heard, {counted} counted as lost", served.len(), heard.len());
        Figures {
            lost: served.len().saturating_sub(heard.len() + counted),
            doubled: heard.values().map(|texts| texts.len() - 1).sum(),
            stale: heard.iter().filter(|(value, texts)| is_stale(**value, &texts[0], &served)).count(),
        }
    }
}

/// Whether the message says that the value was read when the device had the next one already, or before it was served.
fn is_stale(value: u16, text: &str, served: &BTreeMap<u16, SystemTime>) -> bool {
    // Dates have milliseconds, and two clocks are compared.
    let slack = Duration::from_millis(5);
    let time: Timestamp = json(text)["time"].as_str().unwrap().parse().unwrap();
    let time = SystemTime::from(time);
    time + slack < served[&value] || served.get(&(value + 1)).is_some_and(|next| time > *next + slack)
}

const NOTHING: Figures = Figures { lost: 0, doubled: 0, stale: 0 };

/// Five times, or as often as `MOBGATE_KILLS` says; `cargo xtask test broker` has the hundred.
#[test]
fn nothing_is_lost_uncounted_doubled_or_stale_while_the_broker_is_killed_and_started() {
    let kills = env::var("MOBGATE_KILLS").map_or(5, |text| text.parse().expect("a number"));
    let mut load = Load::start(None);
    for kill in 0..kills {
        thread::sleep(Duration::from_millis(1_200 + 37 * (kill % 10)));
        load.broker.kill();
        thread::sleep(Duration::from_millis(100 + 61 * (kill % 7)));
        load.broker.run();
        load.recover();
    }
    let figures = load.figures();
    let Figures { lost, doubled, stale } = figures;
    for (name, count) in [("lost", lost), ("doubled", doubled), ("stale", stale)] {
        let verdict = if count == 0 { "ok" } else { "short" };
        println!("figure mqtt_{name} {count} values-of-{kills}-kills <=0 {verdict}");
    }
    assert_eq!(figures, NOTHING);
}

#[test]
fn nothing_is_lost_uncounted_doubled_or_stale_while_the_network_is_cut_and_the_broker_is_slow() {
    let cable = Cable::new();
    let load = Load::start(Some(&cable));
    for round in 0..3 {
        cable.set(State::Slow);
        thread::sleep(Duration::from_millis(2_000 + 70 * round));
        cable.set(State::Cut);
        thread::sleep(Duration::from_millis(1_500 + 90 * round));
        // What was on its way is lost with the connection, also acknowledgements.
        cable.hang_up();
        cable.set(State::Whole);
        load.recover();
    }
    assert_eq!(load.figures(), NOTHING);
}
