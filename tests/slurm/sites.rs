//! Profiles of public systems as they are shipped, each on a Slurm with the partitions, nodes and
//! limits that the system's documentation states.

use std::io::Write as _;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK};

/// A public system: profile, cores and memory \[MiB\] of a node, lines of slurm.conf, and the
/// partition in which simulations run.
type System = (
    &'static str,
    &'static str,
    &'static str,
    &'static str,
    &'static str,
);

const SYSTEMS: [System; 3] = [
    (
        "lumi",
        "128",
        "224000",
        "PartitionName=standard MaxTime=2-00:00:00 MaxNodes=512 OverSubscribe=EXCLUSIVE\n\
         PartitionName=small MaxTime=3-00:00:00 MaxNodes=4\n\
         PartitionName=debug MaxTime=00:30:00 MaxNodes=4\n",
        "standard",
    ),
    (
        "levante",
        "128",
        "224000",
        "PartitionName=compute MaxTime=08:00:00 OverSubscribe=EXCLUSIVE\n\
         PartitionName=shared MaxTime=7-00:00:00 MaxNodes=1\n",
        "compute",
    ),
    (
        "roihu",
        "384",
        "761856",
        "PartitionName=medium MaxTime=36:00:00 MaxNodes=6 OverSubscribe=EXCLUSIVE\n\
         PartitionName=large MaxTime=36:00:00 MinNodes=6 MaxNodes=60 OverSubscribe=EXCLUSIVE\n\
         PartitionName=small MaxTime=72:00:00 MaxNodes=1\n\
         PartitionName=test MaxTime=00:15:00 MaxNodes=2\n\
         PartitionName=longrun MaxTime=10-00:00:00 MaxNodes=1\n",
        "medium",
    ),
];

pub fn shipped_profiles_run_on_slurms_with_the_sites_partitions(_: &Cluster) {
    for (name, cores, memory_mib, partitions, partition) in SYSTEMS {
        let mut conf = tempfile::NamedTempFile::new().expect("a file");
        conf.write_all(partitions.as_bytes()).expect("lines");
        let options = [
            "--nodes",
            "2",
            "--cpus",
            cores,
            "--memory-mb",
            memory_mib,
            "--no-accounting",
            "--conf",
            conf.path().to_str().expect("a path"),
        ];
        let cluster = Cluster::start("ct-site", &options).unwrap_or_else(|why| panic!("{why}"));
        let cohort = Cohort::of(&cluster, &["01-CoA", "02-CoA"], QUICK)
            .set(&format!("executor.slurm.site={name}"))
            .set("executor.slurm.account=t01")
            .set("executor.slurm.directives=[\"--comment=heart\", \"--exclude=n2\"]");
        assert_eq!(cohort.finish(), 0, "{name}: {:#}", cohort.status());
        let jobs = cohort.jobs();
        assert!(!jobs.is_empty(), "{name}");
        for job in jobs {
            let script = std::fs::read_to_string(job.join("job.sh")).expect("a script");
            for line in [
                format!("#SBATCH --partition={partition}\n"),
                "#SBATCH --exclusive\n".to_owned(),
                "#SBATCH --comment=heart\n".to_owned(),
                "#SBATCH --exclude=n2\n".to_owned(),
            ] {
                assert!(script.contains(&line), "{name}: {line}{script}");
            }
        }
    }
}
