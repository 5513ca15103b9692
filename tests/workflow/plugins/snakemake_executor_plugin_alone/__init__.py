"""An executor of Snakemake whose jobs each run in an empty folder of their own, as on machines without a common disk.

It asks of Snakemake what the one of Kubernetes asks: sources come from the storage, and so do all files.
"""

import os
import subprocess
import tempfile

from snakemake_interface_executor_plugins.executors.base import SubmittedJobInfo
from snakemake_interface_executor_plugins.executors.remote import RemoteExecutor
from snakemake_interface_executor_plugins.settings import CommonSettings

common_settings = CommonSettings(
    non_local_exec=True,
    implies_no_shared_fs=True,
    job_deploy_sources=True,
    auto_deploy_default_storage_provider=False,  # pip would install it
)


class Executor(RemoteExecutor):
    def run_job(self, job):
        folder = tempfile.mkdtemp(prefix=f"{job.name}-", dir=os.environ["ALONE"])
        with open(f"{folder}.log", "w") as log:
            started = subprocess.Popen(
                self.format_job_exec(job), shell=True, cwd=folder, stdout=log, stderr=subprocess.STDOUT
            )
        self.report_job_submission(SubmittedJobInfo(job, aux={"process": started}))

    async def check_active_jobs(self, active_jobs):
        for each in active_jobs:
            code = each.aux["process"].poll()
            if code is None:
                yield each
            elif code == 0:
                self.report_job_success(each)
            else:
                self.report_job_error(each)

    def cancel_jobs(self, active_jobs):
        for each in active_jobs:
            each.aux["process"].terminate()
