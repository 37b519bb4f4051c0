#!/usr/bin/env bash
# Records the answers of a real Slurm that the parsers are tested with. Takes about four minutes.
#   deploy/one-machine-slurm.sh start /tmp/sl.record && coordinator/slurm/tests/recorded/record.sh /tmp/sl.record
# Each file: the command, its exit code, what it said on stdout and on stderr.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cluster=${1:?the folder of a cluster started by deploy/one-machine-slurm.sh}
tool=$here/../../../../deploy/one-machine-slurm.sh
export SLURM_CONF=$cluster/etc/slurm.conf SLURM_TIME_FORMAT=%s LC_ALL=C
cd "$(mktemp -d)"
trap 'rm -rf -- "$PWD"' EXIT

record() { # name, command…
    local name=$1 rc=0
    shift
    timeout 60 "$@" >out 2>err || rc=$?
    { printf '$ %s\nrc %s\n--- stdout\n' "$*" "$rc"; cat out; printf -- '--- stderr\n'; cat err; } >"$here/$name.txt"
    cat out
}
# The exact commands of src/commands.rs.
queue=(squeue --me --array --states=all '--format=ctq|%F|%K|%A|%T|%r|%P|%q|%a|%D|%C|%N|%V|%S|%e|%l|%j|ctq.')
accounting=(sacct --allocations --duplicates --parsable --noconvert --starttime=now-2days --format=JobID,JobIDRaw,State,ExitCode,Reason,Submit,Start,End,ElapsedRaw,NNodes,AllocCPUS,NodeList,Partition,QOS,JobName)
job() { local name=$1; shift; sbatch --parsable --no-requeue --output=/dev/null --job-name="$name" "$@"; }
pid_of() { "$tool" status "$cluster" | awk -v name="$1" '$1 == name { print $2 }'; }
settled() { # waits until no job is left in the queue
    local left=300
    while [ -n "$(squeue --me --noheader --format=%i)" ] && [ "$left" -gt 0 ]; do left=$((left - 1)); sleep 1; done
}

printf '#!/bin/bash\nsleep 1\n' >short.sh
printf '#!/bin/bash\nexec sleep 600\n' >long.sh
record scontrol-config scontrol show config
record sacctmgr-qos sacctmgr --parsable show qos format=Name,Flags,MaxWall,MaxSubmitPU,MaxJobsPU,MaxTRES,MinTRES,MaxTRESPU,GrpTRES,UsageFactor
record sacctmgr-assoc sacctmgr --parsable show assoc where user="$(id -un)" format=Cluster,Account,Partition,QOS,DefaultQOS,MaxSubmit,MaxJobs
record sacctmgr-user-limits sacctmgr --parsable show qos format=Name,MaxWall
record squeue-empty "${queue[@]}"
record sacct-empty "${accounting[@]}" --name=ct-never-submitted

# Refusals
record sbatch-refused-partition sbatch --parsable --partition=nowhere short.sh
record sbatch-refused-account sbatch --parsable --account=nobody short.sh
record sbatch-refused-qos sbatch --parsable --qos=nowhere short.sh
record sbatch-refused-qos-of-partition sbatch --parsable --partition=standard --qos=serial short.sh
record sbatch-refused-walltime sbatch --parsable --partition=standard --qos=short --time=01:00:00 short.sh
record sbatch-refused-partition-time sbatch --parsable --partition=serial --qos=serial --time=5-00:00:00 short.sh
record sbatch-refused-nodes sbatch --parsable --partition=standard --qos=standard --nodes=64 short.sh
record sbatch-refused-qos-nodes sbatch --parsable --partition=standard --qos=taskfarm --nodes=17 short.sh
record sbatch-refused-qos-size sbatch --parsable --partition=standard --qos=largescale --nodes=2 short.sh
record sbatch-refused-memory sbatch --parsable --partition=main --mem=99999999 short.sh
record sbatch-refused-array sbatch --parsable --partition=main --array=0-1001 short.sh
record sbatch-refused-array-text sbatch --parsable --array=banana short.sh
record sbatch-refused-option sbatch --parsable --no-such-option short.sh
record sbatch-refused-no-file sbatch --parsable no-such-file.sh
record sbatch-refused-dependency sbatch --parsable --dependency=afterok:999999 short.sh
record sbatch-refused-submit-limit sbatch --parsable --partition=standard --qos=standard --hold --array=0-64 --job-name=ct-limit short.sh
record sbatch-test-only sbatch --test-only --partition=standard --qos=standard --nodes=2 short.sh
record sbatch-test-only-refused sbatch --test-only --partition=standard --qos=short --time=01:00:00 short.sh

# Answers and states
record sbatch-accepted sbatch --parsable --partition=main --mem=10 --no-requeue --output=/dev/null --job-name=ct-short short.sh
record sacct-lag "${accounting[@]}" --name=ct-short
record sbatch-accepted-array sbatch --parsable --partition=main --mem=10 --no-requeue --output=/dev/null --job-name=ct-array --array=0-7%2 short.sh
job 'odd|name' --partition=main --mem=10 --wrap='exit 3'
job ct-exit3 --partition=main --mem=10 --wrap='exit 3'
job ct-killed --partition=main --mem=10 --wrap='kill -KILL $$'
job ct-walltime --partition=main --mem=10 --time=1 long.sh
job ct-memory --partition=main --mem=20 --wrap='x=$(head -c 200000000 /dev/zero | tr "\0" x); sleep 30'
node=$(job ct-node --partition=main --mem=10 --nodelist=n4 long.sh)
job ct-requeued --requeue --partition=main --mem=10 --nodelist=n4 --wrap='sleep 600'
person=$(job ct-person --partition=main --mem=10 long.sh)
held=$(job ct-held --hold --partition=main --mem=10 long.sh)
job ct-later --begin=now+1hour --partition=main --mem=10 short.sh
job ct-after --dependency=afterok:"$node" --partition=main --mem=10 short.sh
for i in 1 2 3 4 5 6; do job "ct-limit-$i" --partition=serial --qos=serial --mem=10 --time=5 long.sh; done
job ct-two-nodes --partition=standard --qos=standard --nodes=2 long.sh
job ct-priority --partition=standard --qos=standard --nodes=4 long.sh
sleep 6
record squeue-mixed "${queue[@]}"
scancel "$person" "$held"
"$tool" crash "$cluster" n4
until [ "$(squeue --noheader --states=all --jobs="$node" --format=%T)" = NODE_FAIL ]; do sleep 1; done
"$tool" revive "$cluster" n4
record squeue-node-failed "${queue[@]}"
sleep 3
record sacct-node-failed "${accounting[@]}"
scancel --name=ct-requeued
until [ "$(squeue --noheader --states=all --name=ct-walltime --format=%T)" = TIMEOUT ]; do sleep 1; done
scancel --me
settled
sleep 4
record squeue-ended "${queue[@]}"
record sacct-ended "${accounting[@]}"
printf '#!/bin/bash\ntimeout 12 sh -c "while :; do :; done"\nsrun -n 1 timeout 6 sh -c "while :; do :; done"\nexit 0\n' >busy.sh
job ct-busy --partition=main --ntasks=2 busy.sh
settled
sleep 4
record sacct-usage sacct --duplicates --parsable --noconvert --starttime=now-2days --format=JobID,JobIDRaw,ElapsedRaw,AllocCPUS,TotalCPU,ConsumedEnergyRaw,JobName
record squeue-unknown-id squeue --noheader --jobs=987654
record sacct-unknown-id "${accounting[@]}" --jobs=987654

# Daemons that do not answer
kill -STOP "$(pid_of slurmctld)"
record sbatch-frozen sbatch --parsable --partition=main --mem=10 --no-requeue --output=/dev/null --job-name=ct-frozen short.sh
record squeue-frozen "${queue[@]}"
kill -CONT "$(pid_of slurmctld)"
sleep 2
record squeue-thawed "${queue[@]}" --name=ct-frozen
settled
"$tool" kill "$cluster" slurmdbd
record sacct-no-slurmdbd "${accounting[@]}"
record sacctmgr-no-slurmdbd sacctmgr --parsable show qos format=Name
"$tool" revive "$cluster" slurmdbd
"$tool" kill "$cluster" slurmctld
record sbatch-no-slurmctld sbatch --parsable --partition=main short.sh
record squeue-no-slurmctld "${queue[@]}"
"$tool" revive "$cluster" slurmctld
