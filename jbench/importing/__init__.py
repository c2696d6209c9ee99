"""Learning curves that were made outside jbench, as records of the results database.

request.py           what to import: formats, columns, seeds
importer.py          reads all files, then writes a record for each seed
series.py            a learning curve that was read, and the checks of its points
table.py             CSV files as data frames of texts, with the line of each row
monitor.py           monitor.csv of stable-baselines3
evaluations.py       evaluations.npz of stable-baselines3
tensorboard.py       event files of TensorBoard
columns.py           CSV files with columns of any name, and those that W&B exports
"""
