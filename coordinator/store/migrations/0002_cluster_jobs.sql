-- Format 2: jobs of a cluster.
PRAGMA user_version = 2;

-- A submission under a unique name; state and elements in JSON. A name is here before the scheduler hears of it.
CREATE TABLE jobs (
    name        TEXT PRIMARY KEY,
    version     INTEGER NOT NULL,
    over        INTEGER NOT NULL,
    state       TEXT NOT NULL,
    spec        TEXT NOT NULL,
    seen        TEXT NOT NULL,
    intended_ms INTEGER NOT NULL
) WITHOUT ROWID;
CREATE INDEX jobs_at_work ON jobs (over) WHERE over = 0;

-- What a patient's next job is given, and what its earlier ones cost: budgets and changes after failures of the site.
CREATE TABLE allotments (
    patient_id INTEGER PRIMARY KEY REFERENCES patients (id),
    allotment  TEXT NOT NULL
);
