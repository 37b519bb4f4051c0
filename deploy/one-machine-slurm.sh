#!/usr/bin/env bash
# A real Slurm on this machine, for tests and for trying things out: munged, MariaDB, slurmdbd, slurmctld and several
# slurmd "nodes", everything on 127.0.0.1 and under one folder. No system daemon, no /etc/slurm, no systemd, no cgroups.
# Runs as whoever calls it (root or not); only installing packages needs root or sudo.
#
#   deploy/one-machine-slurm.sh start  FOLDER [options]   install what is missing, start; prints `export SLURM_CONF=…`;
#                                                         exit code 3: packages are missing, and cannot be installed here
#   deploy/one-machine-slurm.sh status FOLDER [--json]    exit code 0: all daemons live; 1: some do not
#   deploy/one-machine-slurm.sh stop   FOLDER [--keep-state]   end all daemons and jobs; removes what it made
#   deploy/one-machine-slurm.sh kill   FOLDER NAME        kill -9 one daemon: n1, …, slurmctld, slurmdbd, mariadbd
#   deploy/one-machine-slurm.sh crash  FOLDER NODE        a node's crash: its slurmd and every process of its jobs
#   deploy/one-machine-slurm.sh revive FOLDER NAME        start that daemon again
#
# Options of start: --nodes 4, --cpus 128 and --memory-mb 256000 (of each node, as told to Slurm: the machine needs
# neither), --port PORT (of the first of nodes + 3 free ports; default: searched), --no-accounting (no MariaDB, no
# slurmdbd, no QoS), --conf FILE (more lines for slurm.conf; a partition in it replaces ours of the same name),
# --no-install.
#
# What is there: account t01 for the caller; partitions `standard` (whole nodes, as ARCHER2) and `serial` (cores), with
# QoS whose limits are ARCHER2's, `main` (cores, QoS normal, the default), and `scavenge`, whose jobs make room for those of
# all others. All partitions share the nodes.
set -euo pipefail

say() { printf 'one-machine-slurm: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }
usage() { sed -n '2,/^set -euo/{s/^# \{0,1\}//;/^set -euo/!p}' "$0"; }
case ${1:-} in -h | --help | help) usage; exit 0 ;; esac
[ $# -ge 2 ] || { usage >&2; exit 2; }
PATH=$PATH:/usr/sbin:/sbin
what=$1 folder=$2
shift 2
marker=.one-machine-slurm # says that the folder is ours, and holds the settings of this cluster

# --- processes ---------------------------------------------------------------------------------------------------
alive() { # a zombie that init has not reaped yet counts as dead
    local state
    state=$(sed 's/.*) //' "/proc/$1/stat" 2>/dev/null) && [ -n "$state" ] && [ "${state:0:1}" != Z ]
}
pid_of() { # daemon; prints its pid when it lives and is what the pid file says
    local pid
    pid=$(cat "$ROOT/run/$1.pid" 2>/dev/null) && [ -n "$pid" ] && alive "$pid" || return 1
    # The pid may be another's by now: ours name the folder in their command, or in their environment.
    cat "/proc/$pid/cmdline" "/proc/$pid/environ" 2>/dev/null | tr '\0' '\n' | grep -F -- "$ROOT/" >/dev/null || return 1
    printf '%s\n' "$pid"
}
wait_for() { # seconds, what for, command…; false when it did not come, with what the command said last
    local until=$((SECONDS + $1)) for_what=$2 said
    shift 2
    until said=$("$@" 2>&1); do
        [ "$SECONDS" -lt "$until" ] || { say "$for_what did not come: $said"; return 1; }
        sleep 0.02
    done
}
end() { # signal, daemon: waits until it has ended, and kills what does not
    local pid
    pid=$(pid_of "$2") || return 0
    kill "-$1" "$pid" 2>/dev/null || true
    for _ in $(seq 500); do alive "$pid" || return 0; sleep 0.02; done
    kill -KILL "$pid" 2>/dev/null || true
}
# Processes that daemons of this cluster left: all of them carry its SLURM_CONF in their environment; a job's process has
# a job id there, too; a slurmstepd holds its node's log open. With a node: only that node's.
end_jobs() {
    local node=${1:-} found pid
    for found in $(grep -lzxF -- "SLURM_CONF=$SLURM_CONF" /proc/[0-9]*/environ 2>/dev/null); do
        pid=${found#/proc/} pid=${pid%/environ}
        [ "$pid" != $$ ] && [ "$pid" != $PPID ] || continue
        case $(cat "/proc/$pid/comm" 2>/dev/null) in
        slurmstepd | slurmscriptd)
            [ -z "$node" ] || ls -l "/proc/$pid/fd" 2>/dev/null | grep -F -- "$ROOT/log/slurmd.$node.log" >/dev/null || continue
            ;;
        slurm* | munged | mariadbd) continue ;; # daemons end by their pid files
        *)
            grep -qz '^SLURM_JOB_ID=' "$found" 2>/dev/null || continue
            [ -z "$node" ] || grep -qzx "SLURMD_NODENAME=$node" "$found" 2>/dev/null || continue
            ;;
        esac
        kill -KILL "$pid" 2>/dev/null || true
    done
}

# --- one daemon at a time ----------------------------------------------------------------------------------------
start_munged() {
    munged --force --num-threads=4 --key-file="$ROOT/munge/key" --socket="$ROOT/munge/sock" \
        --pid-file="$ROOT/run/munged.pid" --log-file="$ROOT/log/munged.log" --seed-file="$ROOT/munge/seed" 2>>"$ROOT/log/munged.err"
}
start_mariadbd() {
    # Losing power may lose this database: it is of a test. Nothing here asks the disk to sync.
    setsid mariadbd --no-defaults --datadir="$ROOT/db" --tmpdir="$ROOT/tmp" --socket="$ROOT/run/db.sock" \
        --bind-address=127.0.0.1 --port="$PORT_DB" --pid-file="$ROOT/run/mariadbd.pid" --log-error="$ROOT/log/mariadbd.log" \
        --skip-name-resolve --skip-log-bin --innodb-flush-method=nosync --innodb-flush-log-at-trx-commit=0 \
        --innodb-log-file-size=16M --innodb-buffer-pool-size=64M --innodb-lock-wait-timeout=900 \
        --innodb-buffer-pool-dump-at-shutdown=OFF --innodb-buffer-pool-load-at-startup=OFF \
        ${AS_ROOT:+--user=root} </dev/null >>"$ROOT/log/mariadbd.out" 2>&1 &
    wait_for 60 "MariaDB's socket" test -S "$ROOT/run/db.sock"
    wait_for 60 "MariaDB" sql 'select 1'
}
sql() { mariadb --no-defaults --socket="$ROOT/run/db.sock" --user=root --batch --execute="$1"; }
accounting_answers() { sacctmgr --noheader --parsable2 show cluster; }
start_slurmdbd() { # it finds slurmdbd.conf beside SLURM_CONF
    slurmdbd
    wait_for 30 slurmdbd accounting_answers
}
start_slurmctld() { slurmctld -f "$SLURM_CONF"; }
start_node() { slurmd -N "$1" -f "$SLURM_CONF"; }
start_daemon() {
    case $1 in
    n[0-9]*) start_node "$1" ;;
    munged | mariadbd | slurmdbd | slurmctld) "start_$1" ;;
    *) fail "unknown daemon $1: expected one of $(daemons | tr '\n' ' ')" ;;
    esac
}
daemons() { # in the order of their start
    echo munged
    [ "$ACCOUNTING" = no ] || printf '%s\n' mariadbd slurmdbd
    echo slurmctld
    seq -f 'n%.0f' "$NODES"
}

# --- start -------------------------------------------------------------------------------------------------------
packages() { # missing ones
    local needed=(slurmctld:slurmctld slurmd:slurmd squeue:slurm-client munged:munge) pair
    [ "$ACCOUNTING" = no ] || needed+=(slurmdbd:slurmdbd mariadbd:mariadb-server-core mariadb-install-db:mariadb-server-core mariadb:mariadb-client-core)
    for pair in "${needed[@]}"; do command -v "${pair%%:*}" >/dev/null || echo "${pair##*:}"; done | sort -u
}
install_packages() {
    local missing how=none
    mapfile -t missing < <(packages)
    [ ${#missing[@]} -gt 0 ] || return 0
    if [ "$(id -u)" = 0 ]; then how=""; elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then how="sudo -n"; fi
    if [ "$INSTALL" = no ] || [ "$how" = none ] || ! command -v apt-get >/dev/null; then
        say "missing: ${missing[*]} (Debian package names); install them and run this again"
        exit 3
    fi
    say "installing with apt-get: ${missing[*]}"
    local apt=($how env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300)
    "${apt[@]}" update >&2 || say "apt-get update failed; trying with the lists as they are"
    "${apt[@]}" -y --no-install-recommends install "${missing[@]}" >&2 || { say "missing: ${missing[*]}, which apt-get could not install"; exit 3; }
}
port_is_free() { ! (exec 3<>"/dev/tcp/127.0.0.1/$1") 2>/dev/null; }
free_ports() { # how many in a row; prints the first
    local base offset
    for base in $(seq $((20000 + $$ % 300 * 20)) 20 32000); do # below the range of ports that connections take
        for offset in $(seq 0 $(($1 - 1))); do port_is_free $((base + offset)) || continue 2; done
        echo "$base"
        return 0
    done
    fail "no $1 free ports in a row between 20000 and 32000: give one with --port"
}
write_slurm_conf() {
    local host nodes ports mpi=none
    host=$(hostname -s)
    nodes=n[1-$NODES] ports=$((PORT + 1))-$((PORT + NODES))
    [ "$NODES" -gt 1 ] || { nodes=n1; ports=$((PORT + 1)); }
    [ -z "$(ldconfig -p 2>/dev/null | grep 'libpmix\.so\.2')" ] || mpi=pmix
    cat >"$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$PORT
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
# cred_expire is also how long a requeued job waits: 120 s by default, 5 s is the least that works
AuthInfo=socket=$ROOT/munge/sock,cred_expire=5
CredType=cred/munge
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
MpiDefault=$mpi
MailProg=/bin/true
StateSaveLocation=$ROOT/state
SlurmdSpoolDir=$ROOT/spool/%n
SlurmctldPidFile=$ROOT/run/slurmctld.pid
SlurmdPidFile=$ROOT/run/%n.pid
SlurmctldLogFile=$ROOT/log/slurmctld.log
SlurmdLogFile=$ROOT/log/slurmd.%n.log
SlurmctldDebug=info
SlurmdDebug=info
# of each node: PMIx steps over two nodes of one machine would collide in one folder
TmpFS=$ROOT/tmp/%n
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
TaskProlog=$ROOT/etc/task-prolog
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
ReturnToService=2
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,sched_interval=2,bf_interval=5,default_queue_depth=1000
DependencyParameters=kill_invalid_depend
EnforcePartLimits=ALL
MaxArraySize=1001
MaxJobCount=20000
MinJobAge=300
KillWait=5
KillOnBadExit=1
# at least five times MessageTimeout, or slurmd does not start (24.11)
UnkillableStepTimeout=60
SlurmctldTimeout=30
SlurmdTimeout=10
BatchStartTimeout=10
MessageTimeout=10
NodeName=$nodes NodeHostname=$host NodeAddr=127.0.0.1 Port=$ports CPUs=$CPUS RealMemory=$MEMORY State=UNKNOWN
PreemptType=preempt/partition_prio
PreemptMode=CANCEL
PartitionName=DEFAULT Nodes=$nodes State=UP PriorityTier=10 PreemptMode=OFF DefaultTime=60 DefMemPerCPU=$((MEMORY / CPUS))
CONF
    if [ "$ACCOUNTING" = no ]; then
        cat >>"$SLURM_CONF" <<CONF
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc=$ROOT/log/jobcomp.txt
PartitionName=main Default=YES MaxTime=INFINITE
PartitionName=standard MaxTime=4-00:00:00 OverSubscribe=EXCLUSIVE
PartitionName=serial MaxTime=1-00:00:00 MaxNodes=1
PartitionName=scavenge MaxTime=1-00:00:00 PriorityTier=1 PreemptMode=CANCEL
CONF
    else
        cat >>"$SLURM_CONF" <<CONF
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=127.0.0.1
AccountingStoragePort=$PORT_DBD
# with munge, the socket
AccountingStoragePass=$ROOT/munge/sock
AccountingStorageEnforce=associations,limits,qos
AccountingStoreFlags=job_comment
PartitionName=main Default=YES MaxTime=INFINITE AllowQos=normal
PartitionName=standard MaxTime=4-00:00:00 OverSubscribe=EXCLUSIVE AllowQos=standard,taskfarm,short,long,largescale,lowpriority
PartitionName=serial MaxTime=1-00:00:00 MaxNodes=1 AllowQos=serial
PartitionName=scavenge MaxTime=1-00:00:00 PriorityTier=1 PreemptMode=CANCEL AllowQos=normal
CONF
    fi
    [ -n "$MORE_CONF" ] || return 0
    local partition
    for partition in $(sed -n 's/^PartitionName=\([^ ]*\).*/\1/p' "$MORE_CONF"); do
        [ "$partition" = DEFAULT ] || sed -i "/^PartitionName=$partition /d" "$SLURM_CONF"
    done
    cat "$MORE_CONF" >>"$SLURM_CONF"
}
write_task_prolog() { # nodes of one machine are not to share memory: an MPI that sees one host would mix up their files
    printf '#!/bin/sh\necho export OMPI_MCA_btl=tcp,self\necho export OMPI_MCA_btl_tcp_if_include=lo\necho export MPIR_CVAR_NOLOCAL=1\n' >"$ROOT/etc/task-prolog"
    chmod +x "$ROOT/etc/task-prolog"
}
write_cgroup_conf() { # newer ones set cgroups up even where no plugin wants them, and fail where they may not
    local version plugin=""
    version=$(slurmd -V | sed 's/[^0-9]*//')
    if printf '%s\n' 23.11 "$version" | sort -V -C; then
        plugin=disabled
    elif [ -z "$(ls -A /sys/fs/cgroup 2>/dev/null)" ]; then
        plugin=cgroup/v1 # older ones fail at guessing where no cgroups are mounted, as in a chroot
    fi
    [ -z "$plugin" ] || echo "CgroupPlugin=$plugin" >"$ROOT/etc/cgroup.conf"
}
write_slurmdbd_conf() {
    (
        umask 077 # slurmdbd refuses a file that others can read
        cat >"$ROOT/etc/slurmdbd.conf" <<CONF
AuthType=auth/munge
AuthInfo=socket=$ROOT/munge/sock
CommunicationParameters=NoInAddrAny
DbdHost=localhost
DbdAddr=127.0.0.1
DbdPort=$PORT_DBD
SlurmUser=$(id -un)
PidFile=$ROOT/run/slurmdbd.pid
LogFile=$ROOT/log/slurmdbd.log
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort=$PORT_DB
StorageUser=slurm
StoragePass=$1
StorageLoc=slurm
CommitDelay=1
CONF
    )
}
make_database() {
    mariadb-install-db --no-defaults --force --datadir="$ROOT/db" --tmpdir="$ROOT/tmp" --auth-root-authentication-method=normal \
        --skip-name-resolve --skip-test-db --innodb-flush-method=nosync --innodb-log-file-size=16M \
        ${AS_ROOT:+--user=root} >"$ROOT/log/mariadb-install-db.log" 2>&1 ||
        { tail -n 20 "$ROOT/log/mariadb-install-db.log" >&2; fail "mariadb-install-db failed"; }
}
# ARCHER2's limits, from its user documentation (docs.archer2.ac.uk, user guide, running jobs): nodes and walltime of a
# job, jobs queued and running of a user, nodes of a user. A queued limit counts running jobs, too.
make_accounts() {
    local all=normal,standard,taskfarm,short,long,largescale,lowpriority,serial
    sacctmgr --immediate --quiet >"$ROOT/log/sacctmgr.log" 2>&1 <<QOS || { tail -n 20 "$ROOT/log/sacctmgr.log" >&2; fail "sacctmgr failed"; }
add cluster one
add qos standard Flags=DenyOnLimit MaxTRESPerJob=node=1024 MaxWall=24:00:00 MaxSubmitJobsPerUser=64 MaxJobsPerUser=16 MaxTRESPerUser=node=1024
add qos taskfarm Flags=DenyOnLimit MaxTRESPerJob=node=16 MaxWall=24:00:00 MaxSubmitJobsPerUser=128 MaxJobsPerUser=32 MaxTRESPerUser=node=256
add qos short Flags=DenyOnLimit MaxTRESPerJob=node=32 MaxWall=00:20:00 MaxSubmitJobsPerUser=16 MaxJobsPerUser=4
add qos long Flags=DenyOnLimit MaxTRESPerJob=node=64 MaxWall=96:00:00 MaxSubmitJobsPerUser=16 MaxJobsPerUser=16 MaxTRESPerUser=node=512 GrpTRES=node=2048
add qos largescale Flags=DenyOnLimit MaxTRESPerJob=node=5860 MinTRES=node=1025 MaxWall=12:00:00 MaxSubmitJobsPerUser=8 MaxJobsPerUser=1
add qos lowpriority Flags=DenyOnLimit MaxTRESPerJob=node=2048 MaxWall=24:00:00 MaxSubmitJobsPerUser=16 MaxJobsPerUser=16 UsageFactor=0
add qos serial Flags=DenyOnLimit MaxTRESPerUser=cpu=32,mem=131072 MaxWall=24:00:00 MaxSubmitJobsPerUser=32 MaxJobsPerUser=4 UsageFactor=0
add account t01 cluster=one Description=t01 Organization=t01
add user $(id -un) account=t01 DefaultAccount=t01
modify user where name=$(id -un) set qos=$all DefaultQOS=normal
QOS
}
idle_nodes() { [ "$(sinfo --noheader --Node --partition=main --states=idle --format=%N 2>/dev/null | sort -u | wc -l)" -ge "$NODES" ]; }

start() {
    NODES=4 CPUS=128 MEMORY=256000 PORT="" ACCOUNTING=yes INSTALL=yes MORE_CONF=""
    while [ $# -gt 0 ]; do
        case $1 in
        --nodes) NODES=${2:?$1 needs a number}; shift ;;
        --cpus) CPUS=${2:?$1 needs a number}; shift ;;
        --memory-mb) MEMORY=${2:?$1 needs a number}; shift ;;
        --port) PORT=${2:?$1 needs a number}; shift ;;
        --conf) MORE_CONF=${2:?$1 needs a file}; shift ;;
        --no-accounting) ACCOUNTING=no ;;
        --no-install) INSTALL=no ;;
        *) fail "unknown option $1 of start (see --help)" ;;
        esac
        shift
    done
    local number
    for number in "$NODES" "$CPUS" "$MEMORY" ${PORT:+"$PORT"}; do
        [[ $number =~ ^[1-9][0-9]*$ ]] || fail "expected a whole number above 0, found '$number'"
    done
    [ -z "$MORE_CONF" ] || [ -r "$MORE_CONF" ] || fail "cannot read $MORE_CONF, given with --conf"

    mkdir -p "$folder"
    ROOT=$(cd "$folder" && pwd -P)
    # A Unix socket's path may have 107 bytes.
    [ ${#ROOT} -le 80 ] || fail "the path $ROOT is too long for sockets (${#ROOT} bytes, at most 80): take a shorter one, such as \$(mktemp -d /tmp/sl.XXXX)"
    [[ $ROOT != *[[:space:]]* ]] || fail "the path '$ROOT' holds a blank, which slurm.conf cannot"
    FRESH=yes # not local: the trap below is run when this function is left already
    if [ -e "$ROOT/$marker" ]; then
        [ -e "$ROOT/$marker/settings" ] || fail "$ROOT: another start is under way, or was killed: run stop first"
        FRESH=no # stopped with --keep-state: the same cluster goes on
        settings
        local daemon
        for daemon in $(daemons); do
            pid_of "$daemon" >/dev/null && fail "$ROOT: $daemon runs already (see status)"
        done
    else
        [ -z "$(ls -A "$ROOT")" ] || fail "$ROOT is neither empty nor of a cluster of ours: take another folder"
        mkdir "$ROOT/$marker" || fail "$ROOT: another start is under way"
    fi
    # Whatever stops this start, nothing of it stays.
    trap 'say "start failed; logs:"; tail -n 5 "$ROOT"/log/* >&2 2>/dev/null || true; stop_all KILL; [ "$FRESH" = no ] || remove' EXIT
    install_packages

    SLURM_CONF=$ROOT/etc/slurm.conf AS_ROOT=""
    [ "$(id -u)" != 0 ] || AS_ROOT=yes
    export SLURM_CONF
    if [ "$FRESH" = yes ]; then
        chmod 755 "$ROOT"
        mkdir -p "$ROOT"/{etc,state,spool,log,tmp,run,munge}
        chmod 711 "$ROOT/munge" # clients reach the socket in it
        for number in $(seq "$NODES"); do mkdir -p "$ROOT/spool/n$number" "$ROOT/tmp/n$number"; done
        (umask 077; head -c 128 /dev/urandom >"$ROOT/munge/key")
        PORT=${PORT:-$(free_ports $((NODES + 3)))}
        PORT_DBD=$((PORT + NODES + 1)) PORT_DB=$((PORT + NODES + 2))
        write_slurm_conf
        write_cgroup_conf
        write_task_prolog
    fi
    start_munged
    if [ "$ACCOUNTING" = yes ]; then
        if [ "$FRESH" = yes ]; then
            local password
            password=$(od -An -N16 -tx1 /dev/urandom | tr -d ' \n')
            make_database
            start_mariadbd
            sql "create database slurm; create user 'slurm'@'127.0.0.1' identified by '$password'; grant all on slurm.* to 'slurm'@'127.0.0.1'"
            write_slurmdbd_conf "$password"
            start_slurmdbd
            make_accounts # before slurmctld, which reads them once at its start
        else
            start_mariadbd
            start_slurmdbd
        fi
    fi
    start_slurmctld
    for number in $(seq "$NODES"); do start_node "n$number"; done
    wait_for 60 "idle nodes" idle_nodes || { sinfo >&2 || true; exit 1; }
    printf 'NODES=%s\nACCOUNTING=%s\nPORT=%s\nPORT_DB=%s\n' "$NODES" "$ACCOUNTING" "$PORT" "$PORT_DB" >"$ROOT/$marker/settings"
    trap - EXIT
    echo "export SLURM_CONF=$SLURM_CONF"
}

# --- what follows a start ----------------------------------------------------------------------------------------
settings() { # of the cluster in the folder
    ROOT=$(cd "$folder" 2>/dev/null && pwd -P) || fail "there is no folder $folder"
    [ -e "$ROOT/$marker" ] || fail "$ROOT holds no cluster of ours (no $marker in it)"
    NODES=4 ACCOUNTING=yes AS_ROOT=""
    [ "$(id -u)" != 0 ] || AS_ROOT=yes
    # shellcheck disable=SC1090
    [ ! -e "$ROOT/$marker/settings" ] || . "$ROOT/$marker/settings"
    export SLURM_CONF=$ROOT/etc/slurm.conf
}
stop_all() { # TERM: slurmctld and MariaDB save their state
    local daemon
    end "$1" slurmctld
    for daemon in $(seq -f 'n%.0f' "$NODES"); do end KILL "$daemon"; done
    end_jobs
    end "$1" slurmdbd
    end "$1" mariadbd
    end TERM munged
    rm -f "$ROOT"/run/*
}
remove() {
    rm -rf -- "$ROOT"/{etc,state,spool,log,tmp,run,munge,db,"$marker"}
    rmdir -- "$ROOT" 2>/dev/null || true # stays where somebody put something into it
}
stop() {
    case ${1:-} in
    --keep-state) settings; stop_all TERM ;;
    "") settings; stop_all KILL; remove ;;
    *) fail "unknown option $1 of stop (see --help)" ;;
    esac
}
status() {
    settings
    local daemon pid all=0 json=""
    for daemon in $(daemons); do
        if pid=$(pid_of "$daemon"); then
            json+=",{\"daemon\":\"$daemon\",\"pid\":$pid}"
        else
            pid=- all=1 json+=",{\"daemon\":\"$daemon\",\"pid\":null}"
        fi
        [ "${1:-}" = --json ] || printf '%-10s %s\n' "$daemon" "$pid"
    done
    if [ "${1:-}" = --json ]; then
        printf '{"slurm_conf":"%s","daemons":[%s]}\n' "$SLURM_CONF" "${json#,}"
    else
        echo "export SLURM_CONF=$SLURM_CONF"
    fi
    return "$all"
}
one_daemon() { # kill, crash or revive
    local verb=$1 daemon=${2:-}
    settings
    grep -qxF -- "$daemon" <<<"$(daemons)" || fail "unknown daemon '$daemon': expected one of $(daemons | tr '\n' ' ')"
    case $verb in
    kill) pid_of "$daemon" >/dev/null || fail "$daemon does not run"; end KILL "$daemon" ;;
    crash)
        [[ $daemon == n[0-9]* ]] || fail "only a node crashes; to kill a daemon: kill"
        end KILL "$daemon"
        end_jobs "$daemon"
        ;;
    revive)
        pid_of "$daemon" >/dev/null && fail "$daemon runs already"
        rm -f "$ROOT/run/$daemon.pid"
        [ "$daemon" != mariadbd ] || rm -f "$ROOT/run/db.sock"
        start_daemon "$daemon"
        ;;
    esac
}

case $what in
start) start "$@" ;;
stop) stop "$@" ;;
status) status "$@" ;;
kill | crash | revive) one_daemon "$what" "$@" ;;
*) usage >&2; exit 2 ;;
esac
