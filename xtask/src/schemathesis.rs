//! Requests that schemathesis makes up from docs/openapi.yaml, sent to the program: what comes back must be as described, and never 5xx.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::Value;

use crate::test;
use crate::tools::{Outcome, command, fault, root, run, written};

/// Number of requests.
#[derive(Args)]
pub(crate) struct Choice {
    /// Requests made up for each call, besides those at the limits of the description
    #[arg(default_value_t = 50)]
    examples: u32,
}

const VERSION: &str = "schemathesis==4.32.5";
const FOLDER: &str = "target/schemathesis";
/// Longest wait for the program to start.
const PATIENCE: Duration = Duration::from_secs(30);
/// A user whose password is `let me in`.
const USER: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"";
const CHECKS: &str =
    "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance";
/// A commit of whatever settings ends the interface, a log-out the session, and events and frames do not end, another password ends the session: the tests in boards/linux/tests/web have them.
const LEFT_OUT: [&str; 10] = [
    "--exclude-path",
    "/api/v1/settings/commit",
    "--exclude-path",
    "/api/v1/session",
    "--exclude-path",
    "/api/v1/events",
    "--exclude-path",
    "/api/v1/frames",
    "--exclude-path",
    "/api/v1/password",
];

/// The program, which ends with this.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Installs schemathesis into target/ once, starts the program and has it asked.
pub(crate) fn ask(choice: &Choice) -> Outcome {
    let folder = root().join(FOLDER);
    if !folder.join("bin/st").exists() {
        run(&mut command("python3", &["-m", "venv", FOLDER]))?;
        let pip = ["install", "--quiet", "--disable-pip-version-check", VERSION];
        run(&mut command(folder.join("bin/pip"), &pip))?;
    }
    let program = test::build("mobgate")?;
    let (modbus, web) = (free_port()?, free_port()?);
    let _program = start(&program, &folder, modbus, web)?;
    let token = log_in(web)?;
    let (url, examples) = (format!("http://127.0.0.1:{web}"), choice.examples.to_string());
    let bearer = format!("Authorization: Bearer {token}");
    let described = root().join("docs/openapi.yaml");
    let mut st = command(folder.join("bin/st"), &["run", "--url", &url, "-H", &bearer]);
    st.args(["--no-color", "--max-examples", &examples, "--checks", CHECKS]).args(LEFT_OUT);
    // It keeps what it found in the folder that it runs in.
    run(st.args(["--phases", "examples,coverage,fuzzing"]).arg(described).current_dir(&folder))
}

fn free_port() -> Outcome<u16> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0));
    let address = listener.and_then(|listener| listener.local_addr());
    address.map(|address| address.port()).map_err(|error| format!("no free port: {error}"))
}

/// The program, with a unit that it asks.
fn start(program: &Path, folder: &Path, modbus: u16, web: u16) -> Outcome<Program> {
    let settings = format!(
        "{USER}\nmdns off\nport P502 tcp server 127.0.0.1:{modbus}\nport own tcp client 127.0.0.1:{modbus}\n\
         port web http server 127.0.0.1:{web}\nroute P502 1-9 * * local\n"
    );
    let file = written(folder.join("mobgate.conf"), settings.as_bytes())?;
    let mut started = command(program, &["--socket", "off", "--config"]);
    started.arg(file).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    started.spawn().map(Program).map_err(|error| fault(program, &error))
}

/// The token of a session.
fn log_in(web: u16) -> Outcome<String> {
    let begin = Instant::now();
    let mut stream = loop {
        match TcpStream::connect((Ipv4Addr::LOCALHOST, web)) {
            Ok(stream) => break stream,
            Err(error) if begin.elapsed() > PATIENCE => {
                return Err(format!("the program does not listen: {error}"));
            }
            // Between two looks.
            Err(_) => std::thread::sleep(Duration::from_millis(50)),
        }
    };
    let body = r#"{"user":"anna","password":"let me in","token":true}"#;
    let request = format!(
        "POST /api/v1/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let mut response = String::new();
    let exchanged = stream.write_all(request.as_bytes()).and_then(|()| stream.read_to_string(&mut response));
    exchanged.map_err(|error| format!("log-in: {error}"))?;
    // The object is a chunk, which is a line of its own.
    let body = response.lines().find(|line| line.starts_with('{'));
    let token = body.and_then(|body| serde_json::from_str::<Value>(body).ok());
    let token = token.and_then(|body| body["token"].as_str().map(str::to_owned));
    token.ok_or_else(|| format!("log-in: {response}"))
}
