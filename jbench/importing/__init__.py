"""Learning curves that were made outside jbench, most of them as records of the results database.

request.py           what to import: formats, columns, seeds
importer.py          reads all files, then writes a record for each seed
series.py            a learning curve that was read, and the checks of its points
table.py             CSV files as data frames of texts, with the line of each row
monitor.py           monitor.csv of stable-baselines3
evaluations.py       evaluations.npz of stable-baselines3
tensorboard.py       event files of TensorBoard
columns.py           CSV files with columns of any name, and those that W&B exports
runs.py              imported curves as tables of runs
curve_file.py        curves of any environment in one file, which are reported without an import
"""
