"""Long work in processes of its own, which a kill of any of them cannot lose.

    Supervisor(settings, store).start()     # workers that take jobs from the store, until stop()

requests    what is asked for, with the names of the command line
inputs      the files that a request names, as they were when it was made; names only, never paths
asking      a request as a scenario; the folder in which it is worked on
work        one job as its function takes it
kinds       which function does which kind of job
plan, day, diagnosis  those functions
made        results as bytes
worker      the process that does one job after another, and ends with its server
supervisor  as many workers as there should be
reading     what the readers make of a file, in a process of its own
summaries   the same for each kind of file
"""
