-- Format 1. application_id spells CTWN; user_version is the format that readers and writers compare with theirs.
PRAGMA application_id = 1129600846;
PRAGMA user_version = 1;

CREATE TABLE meta (
    key   TEXT PRIMARY KEY,
    value TEXT NOT NULL
) WITHOUT ROWID;

-- What a scheduler gave: for the local executor one row for each coordinator's life, for Slurm one for each job.
CREATE TABLE allocations (
    id          INTEGER PRIMARY KEY,
    kind        TEXT NOT NULL,
    external_id TEXT NOT NULL,
    host        TEXT NOT NULL,
    opened_ms   INTEGER NOT NULL,
    closed_ms   INTEGER
);

-- Narrow: `status` reads nothing else.
CREATE TABLE patients (
    id             INTEGER PRIMARY KEY,
    patient        TEXT NOT NULL UNIQUE,
    position       INTEGER NOT NULL,
    active         INTEGER NOT NULL,
    version        INTEGER NOT NULL,
    word           TEXT NOT NULL,
    step           TEXT NOT NULL,
    iteration      INTEGER,
    max_iterations INTEGER,
    step1_cost     REAL,
    step1_quality  TEXT,
    step2_cost     REAL,
    failure_class  TEXT,
    note           TEXT NOT NULL,
    since_ms       INTEGER NOT NULL,
    state          TEXT NOT NULL
);

-- The wide part: what the cohort's files give, what reruns changed, what follows, and the chain as far as it is known.
CREATE TABLE plans (
    patient_id INTEGER PRIMARY KEY REFERENCES patients (id),
    given      TEXT NOT NULL,
    overrides  TEXT NOT NULL,
    carried    TEXT NOT NULL,
    plan       TEXT,
    chain      TEXT NOT NULL
);

CREATE TABLE tasks (
    id      INTEGER PRIMARY KEY,
    key     TEXT NOT NULL UNIQUE,
    kind    TEXT NOT NULL,
    version INTEGER NOT NULL,
    word    TEXT NOT NULL,
    state   TEXT NOT NULL,
    spec    TEXT NOT NULL,
    outcome TEXT
);

-- Which task a step of a patient's chain is; a further row when inputs or settings make it another one.
CREATE TABLE steps (
    id         INTEGER PRIMARY KEY,
    patient_id INTEGER NOT NULL REFERENCES patients (id),
    stage      TEXT NOT NULL,
    number     INTEGER NOT NULL,
    task       TEXT NOT NULL REFERENCES tasks (key),
    at_ms      INTEGER NOT NULL
);
CREATE INDEX steps_of_patient ON steps (patient_id);

CREATE TABLE attempts (
    task        TEXT NOT NULL REFERENCES tasks (key),
    generation  INTEGER NOT NULL,
    allocation  INTEGER NOT NULL REFERENCES allocations (id),
    directory   TEXT NOT NULL,
    version     INTEGER NOT NULL,
    word        TEXT NOT NULL,
    over        INTEGER NOT NULL,
    state       TEXT NOT NULL,
    external_id TEXT,
    claim       TEXT,
    planned_ms  INTEGER NOT NULL,
    ended_ms    INTEGER,
    PRIMARY KEY (task, generation)
) WITHOUT ROWID;
CREATE INDEX attempts_at_work ON attempts (over) WHERE over = 0;

CREATE TABLE events (
    sequence   INTEGER PRIMARY KEY,
    at_ms      INTEGER NOT NULL,
    machine    TEXT NOT NULL,
    patient_id INTEGER,
    task       TEXT,
    generation INTEGER,
    event      TEXT NOT NULL
);
CREATE TRIGGER events_are_never_changed BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'events are append-only'); END;
CREATE TRIGGER events_are_never_deleted BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'events are append-only'); END;

-- Actions that are decided and not yet done; a row goes when the action is done. Each may run twice.
CREATE TABLE outbox (
    id     INTEGER PRIMARY KEY,
    at_ms  INTEGER NOT NULL,
    action TEXT NOT NULL
);
